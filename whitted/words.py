"""The ray tree of a pixel as text, and the words that its drawing shares.

A tree has ``pixel`` (x, y), ``radiance`` (three floats) and ``nodes``, a list of dicts, parents first. A node
is a ray and what it meets:

========================== ========================================================================
``id``, ``parent``         numbers; the eye ray's parent is None
``kind``, ``depth``        ``eye``, ``reflection`` or ``transmission``; 0, 1, ...
``origin``, ``direction``  three floats each
``distance``, ``position`` of the hit, or None where the ray escapes
``shape``, ``bsdf``        their ids, or None
``throughput``             the weight with which light along this ray reaches the eye, three floats
``emitted``, ``direct``    light emitted, and direct light reflected, at the hit, unweighted
``contribution``           throughput times the sum of both
``dropped``                None, or why the ray was not traced: ``depth`` or ``cutoff``
``shadow``                 list of dicts: ``emitter``, ``target`` (None: infinitely far), ``direction``,
                           ``distance``, ``transmittance`` (0 to 1), ``contribution``
========================== ========================================================================
"""

from collections import Counter
from dataclasses import dataclass

from whitted import svg


@dataclass(frozen=True)
class Kind:
    """How a kind of ray is shown."""

    letter: str
    colour: str
    words: str


KINDS = {
    "eye": Kind("E", svg.INK, "eye ray"),
    "reflection": Kind("R", "#c8322b", "reflection"),
    "transmission": Kind("T", "#1f6fb5", "transmission"),
}
REASONS = {"depth": "too deep", "cutoff": "too faint"}


def to_text(tree):
    """Return the tree as indented text: a line for each ray, then the pixel's sum and the numbers of rays.

    The weight of a ray is the largest component of its throughput.
    """
    rows = [("ray", "weight", "meets", "distance", "contribution")]
    nodes, children = {node["id"]: node for node in tree.nodes}, children_of(tree)
    stack = [(tree.nodes[0]["id"], "", "")]
    while stack:
        key, lead, indent = stack.pop()
        node = nodes[key]
        rows.append((lead + KINDS[node["kind"]].letter, number(max(node["throughput"])), *outcome(node)))
        count = len(node["shadow"]) + len(children[key])
        branches = [(indent + "├─ ", indent + "│  ")] * (count - 1) + [(indent + "└─ ", indent + "   ")]
        for shadow, (branch, _) in zip(node["shadow"], branches, strict=False):
            rows.append((branch + "S", "", *light(shadow), ""))
        below = zip(children[key], branches[len(node["shadow"]) :], strict=False)
        stack += reversed([(child, *branch) for child, branch in below])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    align = (str.ljust, str.ljust, str.ljust, str.rjust, str.ljust)
    lines = ["  ".join(put(text, n) for put, text, n in zip(align, row, widths, strict=True)) for row in rows]
    total = [sum(node["contribution"][i] for node in tree.nodes) for i in range(3)]
    x, y = tree.pixel
    return "\n".join(
        [*(line.rstrip() for line in lines), f"pixel ({x}, {y}): {colour(total)}; {counts(tree)}"]
    )


def outcome(node):
    """Return what a ray meets, at what distance, and what that contributes, as three texts."""
    if node["dropped"]:
        return f"not traced: {REASONS[node['dropped']]}", "", ""
    if node["position"] is None:
        return "escaped", "", colour(node["contribution"])
    return node["shape"] or "unnamed", number(node["distance"]), colour(node["contribution"])


def light(shadow):
    """Return whether a shadow ray's light arrives, and its distance, as two texts."""
    passed = shadow["transmittance"]
    state = {0: "blocked", 1: "lit"}.get(passed, f"{100 * passed:.3g} % lit")
    return f"{shadow['emitter']}: {state}", "" if shadow["distance"] is None else number(shadow["distance"])


def counts(tree):
    """Return the numbers of rays of each kind, in words."""
    traced = Counter(node["kind"] for node in tree.nodes if not node["dropped"])
    shadows = [shadow for node in tree.nodes for shadow in node["shadow"]]
    blocked = sum(shadow["transmittance"] == 0 for shadow in shadows)
    dropped = sum(bool(node["dropped"]) for node in tree.nodes)
    parts = [f"{traced[kind]} {kind}" for kind in KINDS]
    parts.append(f"{len(shadows)} shadow" + (f" ({blocked} blocked)" if blocked else ""))
    return ", ".join(parts) + (f", {dropped} not traced" if dropped else "")


def children_of(tree):
    """Return a dict from each node's id to its children's ids."""
    found = {node["id"]: [] for node in tree.nodes}
    for node in tree.nodes:
        if node["parent"] is not None:
            found[node["parent"]].append(node["id"])
    return found


def number(value):
    """Return three significant digits."""
    return f"{value:.3g}"


def colour(rgb):
    """Return a grey as one number, others as three."""
    texts = [number(value) for value in rgb]
    return texts[0] if len(set(texts)) == 1 else " ".join(texts)
