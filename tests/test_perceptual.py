"""FLIP and CIEDE2000 against their definitions and published values, and what would stop FLIP's package."""

import numpy as np
import pytest

from whitted.stats.metrics import METRICS
from whitted.stats.perceptual import ciede2000, flip

BLACK, WHITE = np.zeros((24, 24, 3)), np.ones((24, 24, 3))
PICTURE = np.random.default_rng(1).random((24, 24, 3))

# From table 1 of [SharmaWuDalal2005], those within the colours of a screen: L, a, b of two colours, their difference.
SHARMA = [
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((50.0, 2.5, 0.0), (61.0, -5.0, 29.0), 22.8977),
    ((50.0, 2.5, 0.0), (56.0, -27.0, -3.0), 31.9030),
    ((50.0, 2.5, 0.0), (50.0, 3.1736, 0.5854), 1.0000),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((63.0109, -31.0961, -5.8663), (62.8187, -29.7946, -4.0864), 1.2630),
    ((61.2901, 3.7196, -5.3901), (61.4292, 2.2480, -4.9620), 1.8731),
    ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
]
D65 = np.array([0.3127 / 0.3290, 1.0, (1 - 0.3127 - 0.3290) / 0.3290])
RGB_TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(lab):
    """Return the linear Rec. 709 colour of CIE Lab under D65, by the definitions of both."""
    L, a, b = lab
    y = (L + 16) / 116
    f = np.array([y + a / 500, y, y - b / 200])
    xyz = D65 * np.where(f > 6 / 29, f**3, 3 * (6 / 29) ** 2 * (f - 4 / 29))
    return np.linalg.solve(RGB_TO_XYZ, xyz)


def to_lab(rgb):
    xyz = RGB_TO_XYZ @ rgb / RGB_TO_XYZ.sum(axis=1)
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def even(colour, size=2):
    return np.broadcast_to(colour, (size, size, 3))


@pytest.mark.parametrize(("first", "second", "difference"), SHARMA)
def test_published_colour_differences(first, second, difference):
    colours = [linear(lab) for lab in (first, second)]
    assert all(0 <= value <= 1 for colour in colours for value in colour)
    mean, found = ciede2000(*map(even, colours))
    assert mean == pytest.approx(difference, abs=2e-3)
    np.testing.assert_allclose(found, difference, atol=2e-3)
    assert ciede2000(*map(even, colours[::-1]))[0] == pytest.approx(mean)


def test_equal_pictures_do_not_differ():
    for metric in (flip, ciede2000):
        mean, found = metric(PICTURE, PICTURE)
        assert mean == 0
        assert found.shape == (24, 24)
        assert not found.any()


def test_black_and_white_differ_by_a_hundred():
    assert ciede2000(BLACK, WHITE)[0] == pytest.approx(100, abs=1e-3)


def test_exposure_is_in_stops_and_highlights_are_clipped():
    assert ciede2000(PICTURE / 4, PICTURE, exposure=1)[0] == pytest.approx(
        ciede2000(PICTURE / 2, np.minimum(2 * PICTURE, 1))[0]
    )
    assert ciede2000(3 * WHITE, WHITE)[0] == 0
    assert ciede2000(3 * WHITE, WHITE, exposure=-2)[0] > 1


def hunt(rgb):
    """Return Lab with a and b scaled by L, as FLIP does for the Hunt effect."""
    L, a, b = to_lab(np.asarray(rgb, float))
    return np.array([L, 0.01 * L * a, 0.01 * L * b])


def hyab(first, second):
    difference = hunt(first) - hunt(second)
    return abs(difference[0]) + np.hypot(*difference[1:])


def test_flip_of_even_pictures_is_its_colour_difference():
    """[AnderssonEtAl2020], section 4.1.3: a power of the HyAB distance, of which the first 0.4 become 0.95."""
    largest = hyab((0, 1, 0), (0, 0, 1)) ** 0.7
    for grey in (0.2, 1.0):
        power = hyab((0, 0, 0), (grey,) * 3) ** 0.7
        above = 0.95 + (power - 0.4 * largest) / (0.6 * largest) * 0.05
        expected = above if power > 0.4 * largest else 0.95 * power / (0.4 * largest)
        assert flip(grey * WHITE, BLACK, hdr=False)[0] == pytest.approx(expected, abs=2e-4)


def test_srgb_and_linear_are_the_same_picture():
    """A grey of 188 is 0.5029 in linear light."""
    code = np.full((24, 24, 3), 188, np.uint8)
    value = ((188 / 255 + 0.055) / 1.055) ** 2.4
    coded = flip(code, np.zeros_like(code))
    assert coded[0] == pytest.approx(flip(value * WHITE, BLACK, hdr=False)[0], abs=1e-4)
    assert coded[0] != pytest.approx(flip(188 / 255 * WHITE, BLACK, hdr=False)[0], abs=2e-3)


def test_flip_grows_with_the_difference_and_stays_in_its_range():
    noise = np.random.default_rng(2).standard_normal(PICTURE.shape)
    errors = [flip(PICTURE + sd * noise, PICTURE)[0] for sd in (0.01, 0.05, 0.2, 1.0)]
    assert errors == sorted(errors)
    assert errors[0] > 0
    assert errors[-1] <= 1


def test_a_viewer_further_away_sees_less_noise():
    noise = 0.2 * np.random.default_rng(3).standard_normal(PICTURE.shape)
    assert flip(PICTURE + noise, PICTURE, ppd=134)[0] < flip(PICTURE + noise, PICTURE, ppd=34)[0]


def test_high_dynamic_range_is_seen_at_all_exposures():
    reference = 100 * PICTURE
    assert flip(1.2 * reference, reference, hdr=False)[0] < 0.05 < flip(1.2 * reference, reference)[0]


def test_one_channel_is_grey():
    grey = PICTURE[..., :1]
    for metric in (flip, ciede2000):
        wide = metric(np.repeat(0.5 * grey, 3, axis=-1), np.repeat(grey, 3, axis=-1))[0]
        assert metric(0.5 * grey, grey)[0] == pytest.approx(wide)


def dark(lit, value=1.0):
    """Return a black picture of which the first pixels are lit."""
    picture = np.zeros((576, 3))
    picture[:lit] = value
    return picture.reshape(24, 24, 3)


@pytest.mark.parametrize(
    "reference",
    [
        dark(0),
        dark(1),
        dark(1, 1e30),
        dark(100),
        dark(288),
        dark(576, 1e-9),
        dark(1, 1e-9),
        dark(3, 1e-5),
        -WHITE,
    ],
)
def test_dark_references_stop_nothing(reference, capfd):
    """FLIP's package ends the process, or takes dozens of exposures, where it can't choose them."""
    assert flip(reference, reference)[0] == 0
    assert 0 < flip(WHITE, reference)[0] <= 1
    assert capfd.readouterr() == ("", "")


def test_values_that_are_no_numbers_are_not_hidden():
    broken = PICTURE.copy()
    broken[3, 4, 1] = np.nan
    for metric in (flip, ciede2000):
        for pair in ((broken, PICTURE), (PICTURE, broken)):
            mean, found = metric(*pair)
            assert np.isnan(mean)
            assert np.argwhere(np.isnan(found)).tolist() == [[3, 4]]
    broken[3, 4, 1] = np.inf
    assert 0 < flip(broken, PICTURE)[0] < 1


def test_pictures_have_to_match():
    with pytest.raises(ValueError, match="of one size"):
        flip(BLACK, WHITE[:8])
    with pytest.raises(ValueError, match="of one size"):
        ciede2000(BLACK[..., :2], WHITE[..., :2])
    with pytest.raises(ValueError, match="one picture is uint8"):
        flip(BLACK, WHITE.astype(np.uint8))
    with pytest.raises(ValueError, match="linear radiance"):
        ciede2000(BLACK.astype(np.uint8), WHITE.astype(np.uint8))
    with pytest.raises(ValueError, match="ppd is 0"):
        flip(BLACK, WHITE, ppd=0)


def test_they_are_asked_for_by_name():
    assert METRICS["flip"](0.5 * PICTURE, PICTURE) == flip(0.5 * PICTURE, PICTURE)[0]
    assert METRICS["ciede2000"](0.5 * PICTURE, PICTURE) == ciede2000(0.5 * PICTURE, PICTURE)[0]


def test_loading_a_metric_by_name_loads_no_package_before_it_is_used(python):
    done = python(
        "import sys, whitted.stats.metrics, whitted.stats.perceptual\n"
        "print(*{'colour', 'flip_evaluator', 'scipy'} & set(sys.modules))"
    )
    assert (done.stdout.split(), done.stderr) == ([], "")
