"""Curves over time and samples, ratios, and the cheapest setting: exact powers, and the rules for what is not one."""

import numpy as np
import pytest

from whitted.stats.curves import Curve, advantage, cheapest, common_cost, cost_ratio_at, ratio_at
from whitted.stats.intervals import midmean

SPP = np.array([4, 16, 64, 256])


def curve(error=1.0, slope=-1.0, cost=1e-3, replicates=16, noise=0.0, seed=0):
    """Return a curve of errors error * spp^slope at cost * spp seconds, both with relative noise."""
    rng = np.random.default_rng(seed)

    def noisy(values):
        return np.exp(noise * rng.standard_normal((replicates, len(SPP)))) * values

    return Curve(SPP, noisy(cost * SPP), noisy(error * SPP**slope))


def without_seconds(made):
    return Curve(made.spp, None, made.errors)


def test_a_power_of_the_time_is_interpolated_exactly():
    made = curve(error=3.0, slope=-1.7, cost=2e-3)
    for spp in (1, 4, 5.5, 16, 100, 256, 300):
        error = 3.0 * spp**-1.7
        assert made.at(2e-3 * spp) == pytest.approx(error, rel=1e-12)
        assert made.cost_at(error**0.5) == pytest.approx(2e-3 * spp, rel=1e-12)
        assert made.spp_in(2e-3 * spp) == pytest.approx(spp, rel=1e-12)
        assert without_seconds(made).at(spp) == pytest.approx(error, rel=1e-12)
        assert made.spp_at(error**0.5).value == pytest.approx(spp, rel=1e-12)


def test_times_are_means_of_the_middle_half_and_errors_are_means():
    seconds = np.tile([1.0, 2.0], (4, 1))
    seconds[0] = 100
    errors = np.array([[8.0, 1.0], [8.0, 2.0], [8.0, 9.0], [8.0, 4.0]])
    made = Curve(np.array([1, 2]), seconds, errors)
    assert made.span == (1, 2)
    assert made.at(1.0) == pytest.approx(8)
    assert made.at(2.0) == pytest.approx(4)
    assert made.at(2.0, np.array([0, 2, 0, 0])) == pytest.approx(2)
    assert made.at(2.0, np.array([[0, 2, 0, 0], [1, 1, 1, 1]])) == pytest.approx([2, 4])


def test_renders_without_a_time_count_for_the_error_alone():
    timed = curve(noise=0.1)
    seconds = timed.seconds.copy()
    seconds[6:] = np.nan
    made = Curve(SPP, seconds, timed.errors)
    np.testing.assert_allclose(made.costs(), midmean(timed.seconds[:6], np.ones(6)))
    np.testing.assert_allclose(made.band().value, timed.errors.mean(axis=0))
    found = ratio_at(made, curve(noise=0.1, seed=1), 0.05)
    assert found.low < found.value < found.high


def test_times_out_of_order_give_a_curve():
    made = Curve(np.array([1, 2, 4]), np.array([[1.0, 0.9, 3.0]]), np.array([[4.0, 2.0, 1.0]]))
    assert made.at(1.5) == pytest.approx(2 * 1.5 ** -(np.log(2) / np.log(3)), rel=1e-4)


def test_equal_times_bound_nothing():
    """Renders so short that noise orders their times: a resample with equal ones says nothing of other times."""
    errors = np.array([[0.012, 0.0033, 0.0008]])
    equal = Curve(np.array([1, 4, 16]), np.full((1, 3), 2.1e-3), errors)
    assert equal.at(1.1e-3) == np.inf
    assert equal.at(4.2e-3) == 0
    times = np.array([[2.1e-3, 2.1e-3, 2.1e-3]] * 3 + [[0.2e-3, 0.5e-3, 4.9e-3]] * 5)
    noisy = Curve(np.array([1, 4, 16]), times, np.repeat(errors, 8, axis=0))
    found = ratio_at(noisy, curve(noise=0.1), 1.1e-3, paired=False)
    assert found.low < found.value < found.high == np.inf


def test_an_error_that_rises_is_reached_when_it_was_lower():
    made = Curve(np.array([1, 4, 16, 64]), None, np.array([[4.0, 1.0, 2.0, 0.25]]))
    assert made.cost_at(1.0) == pytest.approx(4)
    assert 4 < made.cost_at(0.99) < 64


def test_errors_without_noise_have_no_ratio():
    found = ratio_at(curve(error=0.0), curve(), 0.1)
    assert np.isnan(found.low)
    found, _ = advantage(curve(error=0.0), [curve()], 0.1)
    assert np.isnan(found.low)


def test_an_error_that_is_not_positive_spoils_its_part_of_the_curve_alone():
    errors = curve(noise=0.1).errors.copy()
    errors[:, -1] = -1e-3
    made = Curve(SPP, None, errors)
    assert np.isnan(made.at(100))
    assert made.at(10) > 0


def test_the_common_cost_is_reached_by_all():
    assert common_cost([curve(cost=1e-3), curve(cost=2e-3)]) == pytest.approx(0.256)
    with pytest.raises(ValueError, match="no time"):
        common_cost([curve(cost=1e-3), curve(cost=1.0)])


def test_equal_time_is_no_equal_number_of_samples():
    """Twice the error at a quarter of the cost is half the error, where the error falls as 1/n."""
    ours, others = curve(error=2.0, cost=0.25e-3), [curve(error=5.0), curve()]
    found = ratio_at(ours, others[1], 0.05)
    assert (found.value, found.low, found.high) == pytest.approx((0.5, 0.5, 0.5))
    found, best = advantage(ours, others, 0.05)
    assert (found.value, found.low, found.high) == pytest.approx((2, 2, 2))
    assert best == 1
    found = ratio_at(without_seconds(ours), without_seconds(others[1]), 20)
    assert found.value == pytest.approx(2)


def test_equal_error_is_the_other_way_round():
    """Where the squared error falls as 1/n, a ratio of times at equal error is that of errors at equal time."""
    a, b = curve(error=2.0, cost=0.25e-3), curve()
    assert cost_ratio_at(a, b, 0.1).value == pytest.approx(0.5)
    steep = curve(error=2.0, slope=-2.0), curve(slope=-2.0)
    assert ratio_at(*steep, 0.05).value == pytest.approx(2)
    assert cost_ratio_at(*steep, 0.1).value == pytest.approx(2**0.5)


def test_seconds_at_an_error_have_an_interval():
    made = curve(noise=0.2)
    found = made.seconds_at(0.2)
    assert found.low < found.value < found.high
    assert found.value == pytest.approx(made.cost_at(0.2))


def test_what_slows_a_turn_cancels_in_pairs():
    a, b = curve(error=2.0, cost=2e-3, noise=0.02), curve(noise=0.02, seed=1)
    drift = np.exp(0.2 * np.random.default_rng(2).standard_normal((16, 1)))
    a, b = (Curve(SPP, made.seconds * drift, made.errors) for made in (a, b))
    paired, apart = (ratio_at(a, b, 0.05, paired=paired) for paired in (True, False))
    assert paired.value == pytest.approx(4, rel=0.05)
    assert np.log(apart.high / apart.low) > 2 * np.log(paired.high / paired.low)


def test_curves_of_unequal_replicates_are_independent():
    a, b = curve(noise=0.1), curve(noise=0.1, replicates=9, seed=1)
    assert ratio_at(a, b, 0.05).holds(1)
    with pytest.raises(ValueError, match="16 and 9 replicates are no pairs"):
        ratio_at(a, b, 0.05, paired=True)


def test_bands_hold_the_mean():
    band = curve(noise=0.2).band()
    assert (band.low < band.value).all()
    assert (band.value < band.high).all()
    np.testing.assert_allclose(curve().band().low, 1 / SPP)


def test_the_cheapest_setting_below_an_error():
    """RMSE of 1/2, 1/4, 1/8, 1/16 at cost 4 to 256, and twice of that at an eighth of the cost."""
    a, b = curve(), curve(error=4.0, cost=1e-3 / 8)
    choice = cheapest({"a": a, "b": b}, 0.13)
    assert (choice.name, choice.spp) == ("b", 256)
    assert choice.cost == pytest.approx(0.032)
    assert choice.rmse == pytest.approx(0.125)
    assert choice.bound == pytest.approx(0.125)
    assert cheapest({"a": a}, 0.13).spp == 64
    assert cheapest({"a": without_seconds(a)}, 0.13).cost == 64
    assert cheapest({"a": a, "b": b}, 0.06) is None
    assert cheapest({}, 0.1) is None


def test_an_estimate_below_the_error_is_not_enough():
    made = curve(noise=1.0)
    rmse = np.sqrt(made.errors.mean(axis=0))
    choice = cheapest({"a": without_seconds(made)}, 1.001 * rmse[1])
    assert choice.spp > SPP[1]
    assert choice.rmse <= choice.bound <= 1.001 * rmse[1]


def test_many_curves_are_given_less_risk_each():
    made = without_seconds(curve(noise=0.3))
    alone = cheapest({"a": made}, 0.2)
    among = cheapest(dict.fromkeys("abcdefgh", made), 0.2)
    assert among.spp == alone.spp
    assert among.bound > alone.bound
    assert cheapest({"a": made}, 0.2, level=0.5).bound < alone.bound


def test_a_step_counts_only_where_all_with_more_samples_do():
    errors = np.tile([1e-4, 1.0, 1e-4, 1e-4], (8, 1))
    assert cheapest({"a": Curve(SPP, None, errors)}, 0.1).spp == 64
    errors[:, -1] = np.nan
    assert cheapest({"a": Curve(SPP, None, errors)}, 0.1) is None


def test_costs_have_to_be_of_one_kind():
    with pytest.raises(ValueError, match="over seconds"):
        cheapest({"a": curve(), "b": without_seconds(curve())}, 0.1)
