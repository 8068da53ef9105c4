"""Shares of the variance of functions whose Sobol' indices are known in closed form."""

import numpy as np
import pytest

from whitted.stats.attribution import Attribution

SHAPE = (6, 6)  # of pixels, all of which are the same function
BATCHES, SIZE = 16, 32


def ishigami(x, y, z):
    x, y, z = (np.pi * (2 * u - 1) for u in (x, y, z))
    return np.sin(x) + 7 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)


def g_function(*u):
    return np.prod([(abs(4 * v - 2) + a) / (1 + a) for v, a in zip(u, (0, 1, 9), strict=True)], axis=0)


def indices_of_g():
    parts = np.array([1 / (3 * (1 + a) ** 2) for a in (0, 1, 9)])
    whole = np.prod(1 + parts) - 1
    total = [p * np.prod(1 + np.delete(parts, i)) / whole for i, p in enumerate(parts)]
    return parts / whole, np.array(total)


FUNCTIONS = {
    # First and total order; [SaltelliEtAl2010] for the first two
    "ishigami": (ishigami, [0.3139, 0.4424, 0.0], [0.5576, 0.4424, 0.2437]),
    "g": (g_function, *indices_of_g()),
    "additive": (lambda x, y, z: 3 * x + 4 * y + 0 * z, [9 / 25, 16 / 25, 0], [9 / 25, 16 / 25, 0]),
    "two gates": (lambda x, y, z: (x < 0.5) * (y < 0.5) + 0 * z, [1 / 3, 1 / 3, 0], [2 / 3, 2 / 3, 0]),
    "one alone": (lambda x, y, z: np.exp(x) + 0 * y + 0 * z, [1, 0, 0], [1, 0, 0]),
}
GROUPS = ("x", "y", "z")


def evaluated(function, batches=range(BATCHES), shape=SHAPE, centre=0.0):
    found = Attribution(GROUPS)
    for batch in batches:
        rng = np.random.default_rng([7, batch])
        a, b = rng.random((2, 3, SIZE, *shape))
        mixed = {
            g: function(*(b[j] if j == i else a[j] for j in range(3))) + centre for i, g in enumerate(GROUPS)
        }
        found.add(function(*a) + centre, function(*b) + centre, mixed)
    return found


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_indices_are_those_of_the_closed_form(name):
    function, first, total = FUNCTIONS[name]
    found = evaluated(function)
    shares, interaction = found.shares(level=1 - 1e-4)  # of 35 intervals: a false alarm in 300
    for i, group in enumerate(GROUPS):
        assert abs(shares[group].first.value - first[i]) < 0.02
        assert shares[group].first.low - 1e-12 <= first[i] <= shares[group].first.high + 1e-12
        assert shares[group].total.low - 1e-12 <= total[i] <= shares[group].total.high + 1e-12
        assert found.total(group).mean() == pytest.approx(total[i], abs=0.02)
    assert interaction.value == pytest.approx(1 - sum(first), abs=0.03)


def test_a_group_that_is_all_has_all_exactly():
    shares, _ = evaluated(FUNCTIONS["one alone"][0]).shares()
    assert shares["x"].total.value == pytest.approx(1, abs=1e-12)
    assert shares["y"].total.value == shares["y"].first.value == shares["z"].total.value == 0


def test_the_mean_has_no_say():
    """Without a centre the first order would be drowned in the noise of a mean of 1000."""
    plain, raised = (evaluated(ishigami, centre=c).shares()[0] for c in (0.0, 1000.0))
    for group in GROUPS:
        assert raised[group].first.value == pytest.approx(plain[group].first.value, abs=1e-6)
        width = raised[group].first.high - raised[group].first.low
        assert width == pytest.approx(plain[group].first.high - plain[group].first.low, rel=1e-3)


def test_parts_that_are_added_are_the_whole():
    whole = evaluated(ishigami, range(6))
    parts = evaluated(ishigami, range(4)) + evaluated(ishigami, range(4, 6))
    assert parts.count == whole.count
    np.testing.assert_allclose(parts.variance, whole.variance, rtol=1e-12)
    for group in GROUPS:
        np.testing.assert_allclose(parts.total(group), whole.total(group), rtol=1e-12)
        np.testing.assert_allclose(parts.total_error(group), whole.total_error(group), rtol=1e-9)
    assert str(parts.shares()) == str(whole.shares())
    with pytest.raises(ValueError, match="differ"):
        parts + Attribution(("x",))


def test_pixels_without_variance_have_no_share():
    found = Attribution(("x",))
    values = np.random.default_rng(0).random((3, 8, 1, 2))
    values[..., 1] = 0.25
    found.add(values[0], values[1], {"x": values[1]})
    assert found.total("x").tolist() == [[1.0, 0.0]]
    assert found.first("x")[0, 1] == found.total_error("x")[0, 1] == 0
    still = Attribution(("x",))
    still.add(values[..., 1:][0], values[..., 1:][0], {"x": values[..., 1:][0]})
    shares, interaction = still.shares()
    assert (shares["x"].total.value, interaction.value) == (0, 0)


def test_intervals_and_errors_cover():
    """95 % intervals of the picture and of pixels, in 400 small studies of one pixel."""
    function, first, total = FUNCTIONS["g"]
    held, near = [], []
    for number in range(400):
        found = evaluated(function, [1000 + number], shape=(1, 1))
        shares, _ = found.shares(resamples=399)
        held.append([shares[g].first.holds(f) for g, f in zip(GROUPS, first, strict=True)])
        error = [
            (found.total(g)[0, 0] - t) / found.total_error(g)[0, 0]
            for g, t in zip(GROUPS, total, strict=True)
        ]
        near.append(np.abs(error) < 2)
    assert np.mean(held) > 0.91  # 1,200 tries of 95 %, of ratios from 32 evaluations
    assert np.mean(near) > 0.85  # standard errors of a ratio at 32 evaluations, and two of them


def test_swapped_samples_would_be_seen(monkeypatch):
    add = Attribution.add
    monkeypatch.setattr(Attribution, "add", lambda self, a, b, mixed: add(self, b, a, mixed))
    found, _ = evaluated(ishigami).shares()
    assert not found["y"].total.holds(0.4424)
