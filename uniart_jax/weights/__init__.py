"""Published weights of other projects under our names: tensors in, parameters and config out. Pure:
nothing here writes a file."""
