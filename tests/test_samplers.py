"""The samplers as Mitsuba calls them: which points the lanes get, in loops and in passes.

Seeds are fixed. Had they been drawn at random, each statistical test here would fail for correct code with the
probability that its docstring names, and this file with at most 0.6 %.
"""

import itertools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats
from sobol_samplers import OURS, make, register

from whitted.errors import UsageError
from whitted.sampling.sampler import JOINT

LEVEL = 1e-5  # of one comparison


@pytest.fixture(autouse=True)
def registered(llvm_ad_rgb):
    register()


def seeded(kind, seed=0, width=8, height=8, count=16, **parameters):
    sampler = make(kind, width, height, count, **parameters)
    sampler.seed(seed, width * height * count)
    return sampler


def draw(sampler, pattern):
    """Return the numbers drawn as ``float64`` [numbers, lanes]; ``pattern`` lists 1 and 2 for ``next_1d``, ``2d``."""
    drawn = [sampler.next_1d() if size == 1 else sampler.next_2d() for size in pattern]
    return np.concatenate(
        [np.array(u, np.float64).reshape(size, -1) for u, size in zip(drawn, pattern, strict=True)]
    )


def is_net(x, y):
    """Whether 2^m points have one in each elementary interval of area 2^-m."""
    m = len(x).bit_length() - 1
    cells = [(x * 2**i).astype(int) * 2 ** (m - i) + (y * 2 ** (m - i)).astype(int) for i in range(m + 1)]
    return all(len(np.unique(cell)) == 2**m for cell in cells)


def test_owen_sobol_gives_each_pixel_a_net_of_its_own():
    """In the first two numbers and in each later pair; each number by itself is stratified."""
    numbers = draw(seeded("owen_sobol", width=5, height=3, count=32), [2, 2, 2, 2, 2, 2, 1, 2])
    pixels = numbers.reshape(15, 15, 32).swapaxes(0, 1)
    for points in pixels:
        assert is_net(*points[:2])
        assert all(is_net(*points[k : k + 2]) for k in (8, 10, 13))
        assert all(len(np.unique((u * 32).astype(int))) == 32 for u in points)
    assert len(np.unique(pixels[:, 0])) > 0.99 * 15 * 32


def blocks(u, side, width, height, count):
    """Yield the samples of each aligned square of pixels, from lanes in rows."""
    grid = u.reshape(len(u), height // side, side, width // side, side, count).transpose(1, 3, 0, 2, 4, 5)
    yield from grid.reshape(-1, len(u), side * side * count)


@pytest.mark.parametrize("count", [1, 2, 4, 8])
def test_zsobol_gives_each_square_of_pixels_a_net(count):
    numbers = draw(seeded("zsobol", 3, 16, 8, count), [2, 2, 2, 2, 2, 1, 2])
    for side in (1, 2, 4, 8):
        for points in blocks(numbers, side, 16, 8, count):
            assert is_net(*points[:2])
            assert is_net(*points[8:10])
            assert is_net(*points[11:13])


def test_zsobol_repeats_itself_where_32_bits_are_too_few():
    numbers = draw(seeded("zsobol", 3, 65536, 1, 2), [2, 2]).reshape(4, 2, 32768, 2)
    np.testing.assert_array_equal(numbers[:, 0], numbers[:, 1])
    halves = (numbers[:, 0] * 2).astype(int)
    assert (halves[..., 0] != halves[..., 1]).all()
    assert len(np.unique(numbers[0, 0])) > 0.99 * 65536


def test_squares_of_pixels_are_no_nets_otherwise():
    """With the sides of the screen confused, or with pixels randomised one by one."""
    sampler = make("zsobol", 8, 16, 4)
    sampler.seed(3, 16 * 8 * 4)
    swapped = draw(sampler, [2])
    alone = draw(seeded("owen_sobol", 3, 16, 8, 4), [2])
    for numbers in (swapped, alone):
        assert not all(is_net(*points) for points in blocks(numbers, 2, 16, 8, 4))


@pytest.mark.parametrize("kind", OURS)
def test_numbers_in_a_symbolic_loop_are_those_drawn_before_it(kind):
    """Before a loop the dimension is known when the kernel is made, in it every lane has its own."""
    pattern = [2, 1, 2, 2, 1] * 3
    plain = draw(seeded(kind, 4), pattern)
    for mode in ("symbolic", "evaluated"):
        sampler = seeded(kind, 4)
        rows = dr.zeros(mi.Float, 24 * 1024)
        lane = dr.arange(mi.UInt32, 1024)

        def body(turn, sampler, rows, lane=lane):
            column = turn * 8
            for size in (2, 1, 2, 2, 1):
                u = sampler.next_1d() if size == 1 else sampler.next_2d()
                for value in [u] if size == 1 else [u.x, u.y]:
                    dr.scatter(rows, value, column * 1024 + lane)
                    column = column + 1
            return turn + 1, sampler, rows

        turn = dr.zeros(mi.UInt32, 1024)
        dr.while_loop((turn, sampler, rows), lambda turn, *_: turn < 3, body, mode=mode)
        np.testing.assert_array_equal(np.array(rows).reshape(24, 1024), plain)


@pytest.mark.parametrize("kind", OURS)
def test_lanes_may_draw_different_numbers_of_times(kind):
    """A lane that has left the loop keeps its place in the sequence of numbers."""
    sampler = seeded(kind, 4)
    turns = dr.arange(mi.UInt32, 1024) % 5

    def body(turn, sampler):
        sampler.next_2d()
        return turn + 1, sampler

    dr.while_loop((dr.zeros(mi.UInt32, 1024), sampler), lambda turn, sampler: turn < turns, body)
    u = draw(sampler, [2])
    expected = draw(seeded(kind, 4), [2] * 5).reshape(5, 2, 1024)
    np.testing.assert_array_equal(u, expected[np.arange(1024) % 5, :, np.arange(1024)].T)


@pytest.mark.parametrize("kind", OURS)
@pytest.mark.parametrize(("count", "per_pass"), [(16, 4), (12, 3), (16, 1)])
def test_passes_together_make_the_samples_of_one_pass(kind, count, per_pass):
    whole = draw(seeded(kind, 6, count=count), [2, 2, 2, 2, 2]).reshape(10, 64, count)
    sampler = make(kind, count=count)
    sampler.set_samples_per_wavefront(per_pass)
    sampler.seed(6, 64 * per_pass)
    for first in range(0, count, per_pass):
        part = draw(sampler, [2, 2, 2, 2, 2]).reshape(10, 64, per_pass)
        np.testing.assert_array_equal(part, whole[:, :, first : first + per_pass])
        sampler.advance()
        sampler.schedule_state()
        dr.eval()


def test_zsobol_finds_out_the_samples_of_a_pass_by_itself():
    """Mitsuba's C++ integrators don't tell a sampler in Python."""
    told, untold = make("zsobol"), make("zsobol")
    told.set_samples_per_wavefront(4)
    for sampler in (told, untold):
        sampler.seed(6, 256)
        sampler.advance()
    np.testing.assert_array_equal(draw(told, [2, 2]), draw(untold, [2, 2]))


@pytest.mark.parametrize("kind", OURS)
def test_passes_beyond_the_sample_count_are_new_randomisations(kind):
    sampler = seeded(kind)
    seen = []
    for _ in range(3):
        points = draw(sampler, [2])
        assert all(is_net(*pixel) for pixel in points.reshape(2, 64, 16).swapaxes(0, 1))
        seen.append(points[0])
        sampler.advance()
    assert len(np.unique(np.concatenate(seen))) > 0.99 * 3 * 1024


@pytest.mark.parametrize("kind", OURS)
def test_clones_go_on_alike_and_forks_start_alike(kind):
    sampler = seeded(kind, 9)
    sampler.next_2d()
    clone = sampler.clone()
    assert clone.wavefront_size() == sampler.wavefront_size()
    expected = draw(sampler, [2, 1])
    np.testing.assert_array_equal(draw(clone, [2, 1]), expected)
    fork = sampler.fork()
    fork.seed(9, sampler.wavefront_size())
    np.testing.assert_array_equal(draw(fork, [2]), draw(seeded(kind, 9), [2]))
    assert str(fork) == str(sampler)


@pytest.mark.parametrize("kind", OURS)
def test_seeds_decide_the_numbers(kind):
    same = draw(seeded(kind, 1), [2])
    np.testing.assert_array_equal(draw(seeded(kind, 1), [2]), same)
    np.testing.assert_array_equal(draw(seeded(kind, mi.UInt32(1)), [2]), same)
    base = make(kind, seed=1)
    base.seed(0, 1024)
    for other in (draw(seeded(kind, 2), [2]), draw(seeded(kind, 0), [2]), draw(base, [2])):
        assert (other == same).mean() < 0.01
    np.testing.assert_array_equal(draw(seeded(kind, -1), [2]), draw(seeded(kind, 2**32 - 1), [2]))


def chi_square_2d(x, y, cells=8):
    """The probability that independent uniform numbers fill equal cells as unevenly as these, or less evenly."""
    counts = np.histogram2d(x, y, cells, [(0, 1), (0, 1)])[0]
    return stats.chisquare(counts.ravel()).pvalue


def worst_pair(numbers):
    return min(
        chi_square_2d(numbers[a], numbers[b]) for a, b in itertools.combinations(range(len(numbers)), 2)
    )


@pytest.mark.parametrize("seed", [0, 1])
def test_the_numbers_of_a_sample_are_independent_over_pixels(seed):
    """The first 14 numbers, joint and padded: 91 tests of level 1e-5 for each seed: 0.18 % for both."""
    assert JOINT == 8
    numbers = draw(seeded("owen_sobol", seed, 128, 128, 1), [2] * 7)
    assert worst_pair(numbers) > LEVEL


@pytest.mark.parametrize("kind", OURS)
@pytest.mark.parametrize("lane", [0, 777])
def test_the_numbers_of_a_sample_are_independent_over_seeds(kind, lane):
    """The first 14 numbers of one lane: 91 tests of level 1e-5 for each of four: 0.36 % for all.

    Seeds are small and adjacent, as users choose them.
    """
    sampler = make(kind, 64, 256, 1)
    sampler.seed(dr.arange(mi.UInt32, 1 << 14), 1 << 14)
    sampler.place(dr.full(mi.UInt32, lane, 1 << 14))
    assert worst_pair(draw(sampler, [2] * 7)) > LEVEL


@pytest.mark.parametrize("kind", [*OURS, "multijitter"])
def test_the_samples_of_a_pixel_fill_all_pairs_evenly(kind):
    """Of the first eight numbers, at 4096 samples: not less evenly than independent ones would. Mitsuba's ldsampler
    fills some cells of numbers three apart with many points, and others with none, see below.
    """
    assert worst_pair(draw(seeded(kind, 1, 1, 1, 4096), [2] * 4)) > LEVEL


def test_the_same_check_fails_for_mitsubas_ldsampler():
    assert worst_pair(draw(seeded("ldsampler", 1, 1, 1, 4096), [2] * 4)) < LEVEL


def test_neighbours_and_seeds_are_uncorrelated():
    """12 correlations of level 1e-5: 0.01 %."""
    limit = stats.norm.isf(LEVEL / 2) / np.sqrt(1 << 14)
    numbers = draw(seeded("owen_sobol", 0, 128, 128, 1), [2, 2]).reshape(4, 128, 128)
    others = draw(seeded("owen_sobol", 1, 128, 128, 1), [2, 2]).reshape(4, 128, 128)
    for u, v in zip(numbers, others, strict=True):
        for a, b in ((u[:, 1:], u[:, :-1]), (u[1:], u[:-1]), (u, v)):
            assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < limit


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            {"type": "owen_sobol", "sample_count": 0},
            "sample_count is 0; accepted are whole numbers from 1 to",
        ),
        ({"type": "owen_sobol", "sample_count": -4}, "sample_count is -4; accepted"),
        ({"type": "owen_sobol", "sample_count": 2.5}, "sample_count is 2.5; accepted"),
        ({"type": "owen_sobol", "seed": -1}, "seed is -1; accepted are whole numbers from 0 to 4294967295"),
        ({"type": "zsobol", "width": 8}, "zsobol needs height, a whole number from 1 to 65536"),
        (
            {"type": "zsobol", "width": 0, "height": 8},
            "width is 0; accepted are whole numbers from 1 to 65536",
        ),
        ({"type": "owen_sobol", "jitter": True}, "unreferenced"),
    ],
)
def test_bad_parameters_are_named(parameters, message):
    with pytest.raises(RuntimeError, match=message):
        mi.load_dict(parameters)


def test_too_many_samples_are_refused():
    with pytest.raises(
        UsageError, match="sample_count is 16777217; accepted are whole numbers from 1 to 16777216"
    ):
        make("owen_sobol").set_sample_count((1 << 24) + 1)


def test_zsobol_refuses_a_wavefront_of_another_screen():
    sampler = make("zsobol", 8, 8, 4)
    with pytest.raises(ValueError, match=r"300 samples .* width 8, height 8 and sample_count 4 make 256"):
        sampler.seed(0, 300)
    sampler.seed(0, 1)  # as Mitsuba does after a render


@pytest.mark.parametrize("variant", ["llvm_ad_mono", "llvm_ad_spectral"])
@pytest.mark.parametrize("kind", OURS)
def test_numbers_are_the_same_in_other_variants(kind, variant):
    expected = draw(seeded(kind, 2), [2, 2, 2, 2, 2])
    mi.set_variant(variant)
    register()
    np.testing.assert_array_equal(draw(seeded(kind, 2), [2, 2, 2, 2, 2]), expected)
