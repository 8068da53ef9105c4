"""The statistics of agreement: exact cases, level, power, and what each test is for.

The false-alarm tests repeat with fixed seeds; the bound of each is passed by correct code with a probability
of at least 99.9 %, had the seeds been drawn at random.
"""

import numpy as np
import pytest
from scipy import stats

from whitted.stats.agreement import assess, normal_deviate, student_deviate

R, SIZE = 16, 24


def picture(rng, texture=0.5):
    return np.exp(rng.normal(0, texture, (SIZE, SIZE, 3))).astype(np.float32)


def noisy(rng, mean, sd=0.1, replicates=R):
    return (mean * (1 + sd * rng.standard_normal((replicates, *mean.shape)))).astype(np.float32)


def heavy(rng, mean, replicates=R):
    """Add rare bright events in one corner, as a caustic has them; their mean is 0.4 there."""
    image = noisy(rng, mean, replicates=replicates)
    where = np.zeros((SIZE, SIZE))
    where[14:, 8:] = 0.02
    hit = rng.random((replicates, SIZE, SIZE)) < where
    return image + (hit * rng.exponential(20, hit.shape))[..., None].astype(np.float32)


@pytest.mark.parametrize("dof", [15, 31, 62])
def test_deviates_follow_students_distribution(dof):
    tail = np.array([1e-1, 1e-3, 1e-5, 1e-6])
    t = stats.t.isf(tail, dof)
    np.testing.assert_allclose(normal_deviate(t, dof), stats.norm.isf(tail), atol=0.01)
    np.testing.assert_allclose(student_deviate(normal_deviate(t, dof), dof), t, rtol=1e-9)


def test_equal_pictures_without_noise_agree_exactly():
    image = np.broadcast_to(picture(np.random.default_rng(1)), (8, SIZE, SIZE, 3))
    found = assess(image, image)
    assert found.verdict == "agree"
    assert (found.image.value, found.image.low, found.image.high) == (0, 0, 0)
    assert set(found.p_value.values()) == {1.0}


def test_one_wrong_value_among_noise_free_ones_differs():
    image = np.broadcast_to(picture(np.random.default_rng(1)), (8, SIZE, SIZE, 3))
    wrong = image.copy()
    wrong[:, 5, 7, 1] *= 1.001
    assert assess(wrong, image).verdict == "differ"
    wrong[:, 5, 7, 1] = image[:, 5, 7, 1] * np.float32(1 + 1e-5)  # rounding
    assert assess(wrong, image).verdict == "agree"


def test_a_noise_free_corner_is_compared_exactly_beside_noise():
    rng = np.random.default_rng(3)
    mean = picture(rng)
    a, b = noisy(rng, mean), noisy(rng, mean)
    a[:, :12, :12] = b[:, :12, :12] = mean[:12, :12]
    assert assess(a, b).verdict == "agree"
    a[:, 2, 2] *= 1.001
    assert "without noise" in assess(a, b).reason


def test_black_pictures_agree():
    assert assess(np.zeros((8, 4, 4, 1)), np.zeros((9, 4, 4, 1))).verdict == "agree"


def test_result_is_a_function_of_data_and_seed():
    rng = np.random.default_rng(2)
    a, b = noisy(rng, picture(rng)), noisy(rng, picture(rng))
    first, again = assess(a, b, seed=3), assess(a, b, seed=3)
    assert first.p_value == again.p_value
    assert first.image == again.image


@pytest.mark.parametrize("make", [noisy, heavy])
def test_level_is_kept_between_equal_estimators(make):
    """At a level of 2 %, 100 repetitions give more than 8 alarms with probability 1e-4."""
    rng = np.random.default_rng(4)
    mean = picture(rng)
    alarms = sum(assess(make(rng, mean), make(rng, mean), level=0.02).verdict == "differ" for _ in range(100))
    assert alarms <= 8


def test_level_is_kept_where_one_side_alone_is_noisy():
    """So are an analytic integrator and a path tracer of one scene."""
    rng = np.random.default_rng(5)
    mean = picture(rng)
    exact = np.broadcast_to(mean, (R, *mean.shape))
    alarms = sum(assess(exact, noisy(rng, mean), level=0.02).verdict == "differ" for _ in range(100))
    assert alarms <= 8


def test_interval_covers_the_truth():
    """At 90 % confidence, 200 intervals cover the truth fewer than 165 times with probability 5e-4."""
    rng = np.random.default_rng(6)
    mean = np.full((4, 4, 1), 2.0)
    covered = 0
    for _ in range(200):
        found = assess(noisy(rng, 1.03 * mean), noisy(rng, mean, sd=0.02), level=0.1, permutations=199)
        covered += found.image.low <= 0.03 <= found.image.high
    assert covered >= 165


def test_detectable_bias_is_detected():
    """A bias of the stated size is found 90 times in 100; fewer than 78 have probability 3e-4."""
    rng = np.random.default_rng(7)
    mean = np.ones((8, 8, 1))
    size = assess(noisy(rng, mean), noisy(rng, mean)).smallest_detectable
    runs = (assess(noisy(rng, (1 + size) * mean), noisy(rng, mean), seed=i) for i in range(100))
    found = sum(run.p_value["image mean"] <= run.threshold for run in runs)
    assert found >= 78


def test_interval_decides_between_agree_and_undecided():
    rng = np.random.default_rng(8)
    mean = picture(rng)
    a, b = noisy(rng, mean), noisy(rng, mean)
    assert assess(a, b).verdict == "agree"
    vague = assess(a, b, tolerance=1e-5)
    assert vague.verdict == "undecided"
    assert "image" in vague.reason
    assert assess(a, b, tile_tolerance=1e-4).verdict == "undecided"


def test_a_tolerable_but_certain_difference_differs():
    rng = np.random.default_rng(9)
    mean = picture(rng)
    found = assess(noisy(rng, 1.005 * mean, sd=0.03), noisy(rng, mean, sd=0.03))
    assert found.image.inside(0.01)
    assert found.verdict == "differ"


def test_each_statistic_finds_what_it_is_for():
    rng = np.random.default_rng(10)
    mean = picture(rng)
    local, scattered = mean.copy(), mean * (1 + 0.05 * rng.choice([-1, 1], mean.shape))
    local[4:8, 4:8] *= 1.3
    reference = noisy(rng, mean, replicates=32)
    found = assess(noisy(rng, local, replicates=32), reference)
    assert found.p_value["max 4x4"] <= found.threshold
    assert found.tile.box[:2] == (0, 0)
    found = assess(noisy(rng, scattered, replicates=32), reference)
    assert found.p_value["sum 1x1"] <= found.threshold
    assert found.p_value["image mean"] > found.threshold


def test_a_rare_event_that_one_side_has_missed_is_no_difference():
    """Pixels where no replicate met the event are noise-free, and yet not wrong."""
    rng = np.random.default_rng(11)
    events = rng.poisson(0.1, (32, 32, 32, 1)).astype(np.float32)
    assert (events.var(0) == 0).any()
    exact = np.full((32, 32, 32, 1), 1.1, np.float32)
    assert assess(exact, 1 + events).verdict != "differ"


def test_nonfinite_values_are_reported_and_prevent_agreement():
    rng = np.random.default_rng(12)
    mean = picture(rng)
    a, b = noisy(rng, mean), noisy(rng, mean)
    a[3, 2, 2, 0], b[1, 5, 6, 2], b[2, 5, 6, 1], b[0, 0, 0, 0] = np.nan, np.inf, np.nan, -np.inf
    found = assess(a, b)
    assert found.nonfinite == (1, 2)
    assert found.verdict == "undecided"
    assert np.isfinite(found.image.high)


def test_too_few_replicates_are_refused():
    image = np.zeros((5, 4, 4, 1))
    with pytest.raises(ValueError, match="5 and 5 replicates are too few"):
        assess(image, image)
    with pytest.raises(ValueError, match="one size"):
        assess(image, np.zeros((5, 4, 5, 1)))
