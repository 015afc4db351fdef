"""Train the networks:  python train.py --config configs/nano.py [--stage all] [--workdir DIR] [--any.field value]."""  # noqa: E501

from uniart_jax.cli import train_main

if __name__ == "__main__":
    train_main()
