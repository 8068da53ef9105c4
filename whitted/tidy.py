"""Where to draw the nodes of a tree: parents centred above their children, nothing overlapping.

Reingold and Tilford 1981, "Tidier drawings of trees": each subtree moves as close to its left neighbours as
the outlines of both permit. Left out: the spreading of small subtrees between large ones.
"""


def preorder(root, children):
    """Return all nodes, parents first, of a tree given as a dict from node to list of children."""
    order, stack = [], [root]
    while stack:
        order.append(stack.pop())
        stack += reversed(children[order[-1]])
    return order


def columns(root, children, reach):
    """Return the horizontal place of each node and the width of the whole, in time O(nodes * depth).

    Args:
        root: a node, which is a key of both dicts.
        children: node to list of its children, from left to right.
        reach: node to how far it reaches to the left and to the right of its place, gaps included.

    Returns:
        a dict from node to place, where the leftmost reach is 0, and the width.
    """
    order = preorder(root, children)
    offset, outline = {root: 0.0}, {}  # from the parent; per level, the extent relative to the node
    for node in reversed(order):
        below, shifts = [], []
        for child in children[node]:
            levels = outline.pop(child)
            shift = max((left[1] - right[0] for left, right in zip(below, levels, strict=False)), default=0.0)
            moved = [(low + shift, high + shift) for low, high in levels]
            joint = [(left[0], right[1]) for left, right in zip(below, moved, strict=False)]
            below = joint + below[len(joint) :] + moved[len(joint) :]
            shifts.append(shift)
        middle = (shifts[0] + shifts[-1]) / 2 if shifts else 0.0
        for child, shift in zip(children[node], shifts, strict=True):
            offset[child] = shift - middle
        left, right = reach[node]
        outline[node] = [(-left, right), *((low - middle, high - middle) for low, high in below)]
    low, high = (
        pick(extent) for pick, extent in zip((min, max), zip(*outline[root], strict=True), strict=True)
    )
    places = {root: -low}
    for node in order:
        places |= {child: places[node] + offset[child] for child in children[node]}
    return places, high - low
