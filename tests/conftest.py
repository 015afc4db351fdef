"""Settings of the whole suite: JAX on the CPU, compiled in a hurry; hypothesis draws the same examples every time, without deadlines."""

import os

os.environ.setdefault("JAX_PLATFORMS", "cpu")
# most of the suite's time is compiling, most of that LLVM's: drawing the structure VAE's first weights takes 2 s so, not 20
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=1")

from hypothesis import HealthCheck, settings

settings.register_profile(
    "suite",
    deadline=None,
    derandomize=True,
    max_examples=50,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("suite")
