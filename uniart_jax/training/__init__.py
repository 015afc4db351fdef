"""Training: state, step, sharding, checkpoints, loop, export. Nothing is imported here, so that
each file costs only what it needs."""
