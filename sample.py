"""One image in, an articulated object out:  python sample.py IMAGE [IMAGE …] --out OUT  (see --help)."""  # noqa: E501

from uniart_jax.cli import sample_main

if __name__ == "__main__":
    sample_main()
