"""Which numbers of a sample are coordinates of one point, and how the parts of split samples are numbered."""

import itertools

import mitsuba as mi
import numpy as np
import pytest

from whitted.sampling.draws import Draws, joint_dimensions

PLAN = {"antialiasing", "soft_shadows", "interreflection"}
JOINT = list(joint_dimensions(PLAN))
PADDED = [("gloss", 2), ("gloss", 7), ("light", 1), ("branch", 0)]


def draws_of(count, seed=1):
    index = mi.UInt32(np.arange(count, dtype=np.uint32))
    return Draws(mi.UInt32(3), index, mi.UInt32(seed), mi.UInt32(0), joint_dimensions(PLAN), 16)


def numbers(draws, effect, node):
    return np.array(draws(effect, node), np.float64)


@pytest.mark.parametrize(("effect", "node"), JOINT + PADDED)
def test_parts_of_samples_make_up_one_finer_sequence(effect, node):
    """Of 16 samples with 4 parts each one number lies in every interval of 1/64."""
    draws = draws_of(16).refined()
    u = np.concatenate([numbers(draws.part(mi.UInt32(part), 4), effect, node) for part in range(4)], axis=1)
    for coordinate in u:
        np.testing.assert_array_equal(np.sort((coordinate * 64).astype(int)), np.arange(64))


def most_in_a_cell(first, second):
    """Of 2^12 points in 64 x 64 cells the largest number in one, for each pair of coordinates of two draws."""
    u, v = (numbers(draws_of(1 << 12), *draw) for draw in (first, second))
    cells = [(a * 64).astype(int) * 64 + (b * 64).astype(int) for a in u for b in v]
    return [np.bincount(cell).max() for cell in cells]


@pytest.mark.parametrize(("first", "second"), list(itertools.combinations(JOINT, 2)))
def test_joint_draws_are_coordinates_of_one_point(first, second):
    """The pairs of the dimensions used are (t, 12, 2)-nets with t of at most 1, whatever the scrambling."""
    assert max(most_in_a_cell(first, second)) <= 2


def test_what_is_not_called_for_takes_no_dimension():
    assert not joint_dimensions(set())
    assert joint_dimensions({"antialiasing", "motion_blur"}) == {("pixel", 0): 0, ("time", 0): 2}
    assert joint_dimensions({"depth_of_field", "gloss"}) == {("lens", 0): 0, ("gloss", 0): 2, ("gloss", 1): 4}


@pytest.mark.parametrize("draw", PADDED)
def test_padded_draws_are_shuffled(draw):
    """Some cell has more than 3 of 2^12 independent points but in one of 10^30 cases."""
    assert min(most_in_a_cell(JOINT[0], draw)) > 3


def test_nodes_may_be_mixed():
    """Lanes at several nodes draw what each would draw alone, from joint and from other dimensions."""
    draws, nodes = draws_of(12), np.arange(12, dtype=np.uint32) % 3
    mixed = numbers(draws, "gloss", mi.UInt32(nodes))
    for node in range(3):
        np.testing.assert_array_equal(
            mixed[:, nodes == node], numbers(draws, "gloss", node)[:, nodes == node]
        )


def test_refined_sequences_have_the_same_numbers():
    for effect, node in JOINT + PADDED:
        np.testing.assert_array_equal(
            numbers(draws_of(64).refined(), effect, node), numbers(draws_of(64), effect, node)
        )
