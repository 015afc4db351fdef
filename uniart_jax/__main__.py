"""``python -m uniart_jax …`` is ``uniart …``."""

from uniart_jax.cli import main

if __name__ == "__main__":
    main()
