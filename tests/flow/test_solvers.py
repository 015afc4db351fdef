"""Adaptive solvers and what fixed ones cost, on equations whose solution is known."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from copies import replaced
from jax.experimental import io_callback

from uniart_jax.flow import solvers
from uniart_jax.flow.guidance import guide
from uniart_jax.flow.solvers import euler, heun, solve, time_steps

RATES = np.float32([0.5, 2, 8])  # of dx/dt = rate x from t = 1 to 0: easy to stiff-ish
SOLVERS = ("euler", "heun")


def decay(x, t):
    return RATES[: len(x), None] * x


@functools.partial(jax.jit, static_argnames=("velocity", "solver", "tolerance", "steps", "end"))
def adaptive(x, velocity, solver, tolerance, steps=4, end=0.0, valid=None):
    return solve(velocity, x, solver, steps, 3.0, tolerance=tolerance, end=end, valid=valid)


def ones(*shape):
    return np.ones(shape or (3, 2), np.float32)


def solved(velocity, x, *args, **more):
    """solve() as one program, traced anew."""
    return jax.jit(lambda x: solve(velocity, x, *args, **more))(x)


def counted(velocity, x, *args, **more):
    """solve(), and the times at which the velocity was asked for while it ran."""
    times = []

    def watched(x, t):
        io_callback(lambda t: times.append(np.array(t)), None, t, ordered=True)
        return velocity(x, t)

    found = solved(watched, x, *args, **more)
    jax.effects_barrier()
    return found, times


@pytest.mark.parametrize("solver", SOLVERS)
def test_adaptive_errors_are_of_the_size_asked_for(solver):
    errors = []
    for tolerance in (0.1, 0.03, 0.01):
        found = adaptive(ones(), decay, solver, tolerance)
        error = np.abs(found.x - np.exp(-RATES)[:, None]).max(1)
        assert (error < tolerance).all()
        errors.append(error[:2])
    assert (np.array(errors[-1]) < np.array(errors[0]) / 3).all()  # in proportion, nearly


@pytest.mark.parametrize("solver", SOLVERS)
def test_easy_items_take_fewer_velocities(solver):
    few, some, many = adaptive(ones(), decay, solver, 0.03).evaluations
    assert 3 < few < some < many < 200


def bumpy(x, t):
    """Easy as far as t = .7, then not: the long steps that the beginning allows are wrong there."""
    t = jnp.broadcast_to(jnp.asarray(t, jnp.float32), x.shape[:1])
    return jnp.where(t > 0.7, 1.0, 1 + 3 * jnp.cos(20 * t))[:, None] * jnp.ones_like(x)


@pytest.mark.slow
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_step_that_is_too_long_is_taken_back(solver):
    found, times = counted(bumpy, ones(1, 1), solver, 4, tolerance=0.03)
    asked = np.ravel(times)
    assert (np.diff(asked) > 0).any()  # a later time again
    exact = -3 * np.sin(14) / 20
    assert abs(found.x.item() - exact) < 0.03


def test_after_a_step_that_was_taken_back_the_next_is_no_longer():
    _, times = counted(bumpy, ones(1, 1), "euler", 4, tolerance=0.1)
    ends = np.ravel(times)[
        1:
    ]  # of each try: Euler asks there, and goes on from there if it is good
    at, refused, checked = 1.0, False, 0
    for end, following in itertools.pairwise(ends):
        if following >= end:
            refused = True
            continue
        if refused:
            assert end - following <= (at - end) * 1.001
            checked += 1
        at, refused = end, False
    assert checked


def test_heun_is_the_cheaper_one_where_much_is_asked_and_dearer_where_little():
    cost = {s: adaptive(ones(), decay, s, 0.01).evaluations for s in SOLVERS}
    assert (cost["heun"][1:] < cost["euler"][1:]).all()
    noise = ones(1, 4)  # of x_0 = 0
    straight = {s: adaptive(noise, lambda x, t: jnp.asarray(noise), s, 0.01) for s in SOLVERS}
    for found in straight.values():
        np.testing.assert_allclose(found.x, 0, atol=1e-6)
    # steps of .1, .5, .4: the next is at most five times as long
    assert straight["euler"].evaluations.item() == 4
    assert straight["heun"].evaluations.item() == 6


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("tolerance", [None, 0.1])
def test_velocities_are_counted(solver, tolerance):
    found, times = counted(lambda x, t: 4 * x, ones(1, 2), solver, 4, 3.0, tolerance=tolerance)
    assert found.evaluations.dtype == jnp.int32 and found.evaluations.shape == (1,)
    assert found.evaluations.item() == len(times)
    if tolerance is None:
        assert len(times) == {"euler": 4, "heun": 8}[solver]


def test_a_batch_is_its_items():
    """Neither result nor count of an item depends on what else is in the batch, bit for bit where
    the velocity's own do not."""
    for solver in SOLVERS:
        together = adaptive(ones(), decay, solver, 0.03)
        others = adaptive(replaced(ones(), 2, 1e3), decay, solver, 0.03)
        np.testing.assert_array_equal(together.x[:2], others.x[:2])
        np.testing.assert_array_equal(together.evaluations[:2], others.evaluations[:2])
        alone = adaptive(ones(1, 2), decay, solver, 0.03)
        np.testing.assert_allclose(alone.x[0], together.x[0], rtol=1e-6)
        assert alone.evaluations[0] == together.evaluations[0]


def test_an_item_that_cannot_be_solved_ends_and_harms_nobody():
    def broken(x, t):
        return jnp.where(jnp.arange(3)[:, None] == 1, jnp.nan, decay(x, t))

    for solver in SOLVERS:
        found, good = (adaptive(ones(), v, solver, 0.1) for v in (broken, decay))
        assert np.isnan(found.x[1]).all() and found.evaluations[1] < 20
        for item in (0, 2):
            np.testing.assert_array_equal(found.x[item], good.x[item])
            assert found.evaluations[item] == good.evaluations[item]


@pytest.mark.parametrize("garbage", [1e6, np.nan])
@pytest.mark.parametrize("solver", SOLVERS)
def test_padding_neither_moves_a_valid_row_nor_counts_as_error(solver, garbage):
    valid = np.array([[True, True, False]] * 2)[..., None]
    x = ones(2, 3, 4)

    def clean(x, t):
        return 2 * x

    def dirty(x, t):
        wobble = jnp.sin(50 * t).reshape(-1, 1, 1) * garbage
        return jnp.where(valid, 2 * x, wobble)

    expected = adaptive(x[:, :2], clean, solver, 0.03)
    found = adaptive(x, dirty, solver, 0.03, valid=valid)
    spoiled = np.where(valid, x, np.float32(garbage))
    start = adaptive(spoiled, dirty, solver, 0.03, valid=valid)
    for case in (found, start):
        np.testing.assert_allclose(case.x[:, :2], expected.x, rtol=1e-6)
        np.testing.assert_array_equal(case.evaluations, expected.evaluations)
    unmasked = adaptive(x, dirty, solver, 0.03)
    assert (unmasked.evaluations != expected.evaluations).all()


def test_the_same_again():
    runs = [adaptive(ones(), decay, "heun", 0.03) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].x, runs[1].x)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("tolerance", [None, 0.1])
def test_below_the_end_one_euler_step_and_no_velocity(solver, tolerance):
    """As a network that predicts x_0 needs it: there its velocity is a small difference over a
    small t."""
    x0 = np.full((1, 2), 0.25, np.float32)

    def of_data(x, t):
        return (x - x0) / jnp.maximum(jnp.reshape(t, (-1, 1)), 0.05)

    found, times = counted(of_data, ones(1, 2), solver, 4, 3.0, tolerance=tolerance, end=0.05)
    np.testing.assert_allclose(found.x, x0, atol=1e-5)
    assert min(float(t.min()) for t in times) >= 0.05 - 1e-6
    assert found.evaluations.item() == len(times)
    if tolerance is None:
        assert len(times) == {"euler": 4, "heun": 7}[solver]


@pytest.mark.parametrize("solver", SOLVERS)
def test_many_fixed_steps_leave_out_the_times_below_the_end(solver):
    """The last of sixty is .048."""
    x0 = np.full((1, 2), 0.25, np.float32)

    def of_data(x, t):
        v = (x - x0) / jnp.maximum(jnp.reshape(t, (-1, 1)), 0.05)
        return jnp.where(t < 0.05 - 1e-6, jnp.nan, v)  # asked for there, it shows

    times = time_steps(60, 3.0)
    assert times[-2] < 0.05 < times[-3]
    found = solved(of_data, ones(1, 2), solver, 60, 3.0, end=0.05)
    np.testing.assert_allclose(found.x, x0, atol=1e-5)
    assert found.evaluations.item() == {"euler": 59, "heun": 117}[solver]
    np.testing.assert_array_equal(time_steps(25, 3.0, 0.05), time_steps(25, 3.0))  # .111 is last


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("end", [0.0, 0.05])
def test_a_jump_close_to_the_end_is_passed(solver, end, monkeypatch):
    """As at the edge of a guidance interval. A least step stretched to the end is taken: otherwise
    it is rejected and tried again for ever."""
    monkeypatch.setattr(solvers, "MOST", 10**6)  # without help
    edges = np.float32(end + np.linspace(1e-4, 1.2e-3, 64))

    def jump(x, t):
        return jnp.where(t >= edges, 2.0, 0.0)[:, None] * x

    x = np.linspace(1, 3, 64, dtype=np.float32)[:, None] * ones(1, 4)
    found = bounded(jump, x, solver, 0.01, end)
    assert np.isfinite(found.x).all() and (found.evaluations < 1000).all()
    assert solver == "heun" or (found.steps_over_tolerance >= 1).all()


def test_a_velocity_of_half_precision_comes_to_an_end(monkeypatch):
    """The error of a short step is rounding, which no shorter one lowers."""
    monkeypatch.setattr(solvers, "MOST", 10**6)

    def coarse(x, t):
        return (x + 0.3 * jnp.sin(40 * x)).astype(jnp.bfloat16).astype(jnp.float32)

    noise = np.float32(np.random.default_rng(0).normal(size=(32, 64)))
    found = bounded(coarse, noise, "euler", 1e-3, 0.0)
    assert np.isfinite(found.x).all() and (found.evaluations < 2900).all()


def bounded(velocity, x, solver, tolerance, end):
    """solve() in a loop that gives up, where the solver's own would go on for ever."""
    loop = jax.lax.while_loop

    def limited(condition, body, start):
        def go_on(carry):
            return condition(carry[0]) & (carry[1] < 3000)

        return loop(go_on, lambda carry: (body(carry[0]), carry[1] + 1), (start, 0))[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jax.lax, "while_loop", limited)
        return solved(velocity, x, solver, 25, 3.0, tolerance=tolerance, end=end)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("end", [0.0, 0.05])
def test_after_so_many_velocities_one_step_is_left(solver, end, monkeypatch):
    monkeypatch.setattr(solvers, "MOST", 20)
    found = solved(decay, ones(), solver, 4, 3.0, tolerance=1e-4, end=end)
    assert (found.evaluations >= 20).all() and (found.evaluations <= 23).all()
    assert (found.steps_over_tolerance >= 1).all()  # and is told
    monkeypatch.setattr(solvers, "MOST", 4000)
    exact = solved(lambda x, t: x, ones(), solver, 4, 3.0, tolerance=1e-2, end=end)
    assert not np.asarray(exact.steps_over_tolerance).any()
    assert np.isfinite(found.x).all()


def test_heun_of_one_step_with_an_end_is_euler():
    x = ones()
    np.testing.assert_array_equal(heun(decay, x, 1, end=0.05), euler(decay, x, 1))


@pytest.mark.parametrize("solver", SOLVERS)
def test_rescaled_fixed_steps_keep_their_order(solver):
    def error(steps):
        x = solved(lambda x, t: x, ones(1, 1), solver, steps, 3.0).x
        return abs(x.item() - np.exp(-1.0))

    least, most = {"euler": (1.7, 2.3), "heun": (3.2, 4.8)}[solver]
    assert least < error(10) / error(20) < most


def test_guidance_where_items_are_at_times_of_their_own():
    def velocity(x, t, condition):
        assert t.shape == (x.shape[0],)
        return x * 0 + condition

    condition, negative = np.float32([[0], [1]]), np.full((2, 1), 10, np.float32)
    guided = jax.jit(guide(velocity, condition, negative, 2.0, (0.5, 1.0)))
    x, t = np.zeros((2, 3), np.float32), np.float32([0.4, 0.6])
    np.testing.assert_allclose(np.asarray(guided(x, t))[:, 0], [0, 1 + 2 * (1 - 10)])
    np.testing.assert_allclose(np.asarray(guided(x, t[::-1]))[:, 0], [0 + 2 * (0 - 10), 1])


@pytest.mark.parametrize(
    ("steps", "tolerance", "says"),
    [(0, None, "at least 1"), (0, 0.1, "at least 1"), (4, 0.0, "0.0001..1"), (4, 2.0, "0.0001..1")],
)
def test_nonsense_is_refused(steps, tolerance, says):
    with pytest.raises(ValueError, match=says):
        solve(decay, ones(), "euler", steps, tolerance=tolerance)
