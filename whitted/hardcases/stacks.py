"""The stack of the ray tree: as large as it is needed, and each lane's its own."""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted import transport
from whitted.hardcases.arrays import U
from whitted.hardcases.case import Errors, case
from whitted.hardcases.scenes import FAMILY


@case(
    "42", FAMILY, unit="of the bound",
    sweep=("depth", (1.0, 4.0, 8.0, 12.0)), tolerance=1,
    why="2^depth leaves, and weights that sum to 1 to 2 u for each level and u for each sum",
    source="Whitted1980",
)  # fmt: skip
def tree_of_two_children(depth):
    """Leaves of a ray tree that branches at each level, and their weights, with the stack that it is given."""
    width, levels = 37, int(depth)
    Node = transport.node_type(mi.variant())
    share = mi.Float(np.random.default_rng(42).uniform(0.1, 0.9, width).astype(np.float32))
    stack = transport.Stack.empty(Node, transport.capacity(2, levels + 1), width)

    def step(active, node, leaves, total, *arrays):
        walk = stack.with_state(*arrays)
        at_leaf = active & (node.depth == levels)
        leaves, total = leaves + dr.select(at_leaf, mi.UInt32(1), 0), total + dr.select(at_leaf, node.w.x, 0)
        next_node, has_next = node, mi.Bool(False)
        for part in (share, 1 - share):
            child = Node(node.o, node.d, node.w * part, node.eta, node.depth + 1, node.tag, node.id)
            next_node, has_next = walk.push_all_but_first(child, active & ~at_leaf, next_node, has_next)
        node, popped = walk.pop(next_node, active & ~has_next)
        return has_next | popped, node, leaves, total, *walk.state

    zero = mi.UInt32(0)
    root = Node(mi.Point3f(0), mi.Vector3f(0), mi.Spectrum(1), mi.Float(1), zero, zero, zero)
    start = (
        dr.full(mi.Bool, True, width),
        root,
        dr.zeros(mi.UInt32, width),
        dr.zeros(mi.Float, width),
        *stack.state,
    )
    _, _, leaves, total, *_ = dr.while_loop(start, lambda active, *_: active, step, label="tree")
    bound = (2 * levels + 2.0**levels) * U
    return Errors(ours=[*(np.array(leaves) - 2.0**levels), *((np.array(total, np.float64) - 1) / bound)])


WIDTHS = (1.0, 16.0, 17.0, 1024.0)
STEPS, DEPTH = 100, 16


@case(
    "42, R3", FAMILY, unit="of the lanes",
    sweep=("lanes", WIDTHS), tolerance=0,
    why="the pointer has a number for each lane; textbook: it starts as one for all", source="a stack in Python",
)  # fmt: skip
def stack_of_each_lane(width):
    """Lanes of a stack in local memory that give back other numbers than a stack does."""
    width = int(width)
    rng = np.random.default_rng(4242)
    pushes = rng.random((STEPS, width)) < 0.6
    expected = np.array([_played(lane) for lane in pushes.T]).T
    pointers = dr.zeros(mi.UInt32, width), mi.UInt32(0)
    return Errors(*(np.mean(_play(pushes, pointer) != expected) for pointer in pointers))


def _played(pushes):
    """What a list gives, and the sum of all that was taken, each weighed by its turn."""
    stack, total = [], 0
    for turn, push in enumerate(pushes):
        if push and len(stack) < DEPTH:
            stack.append(turn + 1)
        elif not push and stack:
            total += stack.pop() * (turn + 1)
    return total


def _play(pushes, pointer):
    """The same by `transport.Stack`, each lane for itself, ``int`` [N]."""
    width = pushes.shape[1]
    bits = mi.UInt32(pushes.astype(np.uint32).ravel())
    lane = dr.arange(mi.UInt32, width)
    stack = transport.Stack(DEPTH, dr.alloc_local(mi.UInt32, DEPTH), pointer)

    def step(turn, total, *arrays):
        walk = stack.with_state(*arrays)
        push = dr.gather(mi.UInt32, bits, turn * width + lane) == 1
        walk.push(turn + 1, push)
        taken, popped = walk.pop(mi.UInt32(0), ~push)
        return turn + 1, total + dr.select(popped, taken * (turn + 1), 0), *walk.state

    start = dr.zeros(mi.UInt32, width), dr.zeros(mi.UInt32, width), *stack.state
    _, total, *_ = dr.while_loop(start, lambda turn, *_: turn < STEPS, step, label="stack")
    return np.array(total).astype(int)
