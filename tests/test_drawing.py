"""Ray trees as text and as drawings: nothing is lost, nothing overlaps, and the file is valid."""

import xml.etree.ElementTree as ET
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from whitted import drawing, planview, svg, tidy, words

LAST = ["3", "shadow", "(1", "blocked),", "1", "not", "traced"]
SVG = "{http://www.w3.org/2000/svg}"


def ray(nodes, kind="eye", parent=None, target=None, weight=1.0, direct=0.0, **more):
    """Append a ray to ``nodes``: it hits ``target``, or escapes."""
    origin = np.array([0, 1, -6.0] if parent is None else parent["position"])
    towards = np.array([0, 0, 1.0]) if target is None else np.array(target, float) - origin
    distance = float(np.linalg.norm(towards))
    hit = target is not None
    node = {
        "id": len(nodes),
        "parent": None if parent is None else parent["id"],
        "kind": kind,
        "depth": 0 if parent is None else parent["depth"] + 1,
        "origin": origin.tolist(),
        "direction": (towards / distance).tolist(),
        "distance": distance if hit else None,
        "position": [float(value) for value in target] if hit else None,
        "shape": "sphere" if hit else None,
        "bsdf": "glass" if hit else None,
        "throughput": [weight] * 3,
        "emitted": [0.0] * 3,
        "direct": [direct] * 3,
        "contribution": [weight * direct] * 3,
        "dropped": None,
        "shadow": [],
    } | more
    nodes.append(node)
    return node


def light(node, emitter, target, transmittance=1.0):
    towards = np.array(target or [0, 1, 0], float) - (node["position"] if target else 0)
    distance = float(np.linalg.norm(towards))
    shadow = {
        "emitter": emitter,
        "target": target,
        "direction": (towards / distance).tolist(),
        "distance": distance if target else None,
        "transmittance": transmittance,
        "contribution": [0.1] * 3,
    }
    node["shadow"].append(shadow)


def tree_of(nodes):
    radiance = np.sum([node["contribution"] for node in nodes], axis=0).tolist()
    return SimpleNamespace(pixel=(3, 4), radiance=radiance, nodes=nodes)


def small_tree():
    nodes = []
    root = ray(nodes, target=[0, 1, 0], direct=0.02, shape="shell")
    light(root, "lamp", [3, 6, -2])
    light(root, "sun", None, 0.0)
    floor = ray(nodes, "reflection", root, [-3, 0, -4], 0.06, 0.8, shape="floor")
    light(floor, "lamp", [3, 6, -2], 0.35)
    inside = ray(nodes, "transmission", root, [0.1, 0.9, 1], 0.94)
    ray(nodes, "transmission", inside, None, 0.9, 0.5)
    ray(nodes, "reflection", inside, None, 0.0009, dropped="cutoff")
    return tree_of(nodes)


def full_tree(levels, lights=1):
    """Return the tree in which every hit has two children: 2^levels - 1 nodes."""
    rng, nodes = np.random.default_rng(1), []
    names = ["floor", "s", "a_rather_long_name_of_a_shape"]
    level = [ray(nodes, target=[0, 1, 0], shape=names[0])]
    for _ in range(levels - 1):
        children = []
        for parent in level:
            for kind, part in (("reflection", 0.1), ("transmission", 0.9)):
                target = np.array(parent["position"]) + rng.standard_normal(3)
                weight = part * parent["throughput"][0]
                children.append(ray(nodes, kind, parent, target, weight, shape=names[rng.integers(3)]))
        level = children
    for node in nodes:
        for i in range(lights):
            light(node, f"light_{i}", [i, 5, 1], float(rng.integers(2)))
    return tree_of(nodes)


def chain(length):
    nodes = []
    node = ray(nodes, target=[0, 0, 0])
    for i in range(1, length):
        node = ray(nodes, "reflection", node, [(-1) ** i, 0.1 * i, 0], 0.99**i)
    ray(nodes, "reflection", node, None, 0.5, dropped="depth")
    return tree_of(nodes)


TREES = {
    "escaped": lambda: tree_of([ray([], direct=0.5)]),
    "one hit": lambda: tree_of([ray([], target=[0, 1, 0])]),
    "straight down": lambda: tree_of([ray([], target=[0, -5, -6])]),
    "at the eye": lambda: tree_of([ray([], target=[0, 1, -6 + 1e-12])]),
    "far": lambda: tree_of([ray([], target=[0, 1, 1e9])]),
    "small": small_tree,
    "7 nodes": lambda: full_tree(3, lights=2),
    "127 nodes": lambda: full_tree(7),
    "many lights": lambda: full_tree(2, lights=30),
    "chain": lambda: chain(120),
}


def texts(document):
    return [element.text for element in ET.fromstring(document).iter(SVG + "text")]


@pytest.mark.parametrize("name", TREES)
def test_drawing_is_valid_and_whole(name):
    tree = TREES[name]()
    document = drawing.to_svg(tree)
    root = ET.fromstring(document)
    width, height = (float(root.get(side)) for side in ("width", "height"))
    assert "nan" not in document
    for element in root.find(SVG + "g").iter():  # the tree
        if element.tag == SVG + "circle":
            assert 0 <= float(element.get("cx")) <= width
            assert 0 <= float(element.get("cy")) <= height
    numbers = [str(node["id"]) for node in tree.nodes if not node["dropped"]]
    assert not set(numbers) - set(texts(document))
    assert not {"script", "image", "style"} & {element.tag.removeprefix(SVG) for element in root.iter()}
    assert "href" not in document


@pytest.mark.parametrize("name", TREES)
def test_boxes_do_not_overlap(name):
    tree = TREES[name]()
    placed, (width, height) = drawing.place(tree)
    assert set(placed) == {node["id"] for node in tree.nodes}
    for _, _, left, top, right, bottom in placed.values():
        assert left >= 0
        assert top >= 0
        assert right <= width
        assert bottom <= height
    for a, b in combinations(placed.values(), 2):
        assert a[4] <= b[2] or b[4] <= a[2] or a[5] <= b[3] or b[5] <= a[3]


@pytest.mark.parametrize("name", ["small", "127 nodes", "chain"])
def test_parents_are_centred_above_their_children(name):
    tree = TREES[name]()
    placed, _ = drawing.place(tree)
    for parent, children in words.children_of(tree).items():
        if children:
            xs = [placed[child][0] for child in children]
            assert placed[parent][0] == pytest.approx((min(xs) + max(xs)) / 2)
            assert all(placed[child][1] > placed[parent][5] for child in children)
            assert xs == sorted(xs)


def test_layout_is_compact():
    placed, width = tidy.columns(0, {0: [1, 2], 1: [3], 2: [], 3: []}, dict.fromkeys(range(4), (1, 1)))
    assert placed == {0: 2, 1: 1, 2: 3, 3: 1}
    assert width == 4


def test_text():
    lines = words.to_text(small_tree()).splitlines()
    assert [line.split() for line in lines] == [
        ["ray", "weight", "meets", "distance", "contribution"],
        ["E", "1", "shell", "6", "0.02"],
        ["├─", "S", "lamp:", "lit", "6.16"],
        ["├─", "S", "sun:", "blocked"],
        ["├─", "R", "0.06", "floor", "5.1", "0.048"],
        ["│", "└─", "S", "lamp:", "35", "%", "lit", "8.72"],
        ["└─", "T", "0.94", "sphere", "1.01", "0"],
        ["├─", "T", "0.9", "escaped", "0.45"],
        ["└─", "R", "0.0009", "not", "traced:", "too", "faint"],
        [*["pixel", "(3,", "4):", "0.518;", "1", "eye,", "1", "reflection,", "2", "transmission,"], *LAST],
    ]
    assert len({line.index("lamp") for line in lines if "lamp" in line}) == 1
    assert lines[7].startswith("   ├─ T")


def test_text_of_colours_and_of_deep_trees():
    nodes = []
    ray(nodes, contribution=[0.25, 0.5, 1.0])
    assert words.to_text(tree_of(nodes)).endswith(
        "pixel (3, 4): 0.25 0.5 1; 1 eye, 0 reflection, 0 transmission, 0 shadow"
    )
    text = words.to_text(chain(2000))
    assert len(text.splitlines()) == 2003
    assert "not traced: too deep" in text


def test_drawing_says_what_the_tree_holds():
    shown = texts(drawing.to_svg(small_tree()))
    for label in (
        "E 1",
        "R 0.06",
        "T 0.94",
        "R 0.0009",
        "shell",
        "floor",
        "escaped",
        "too faint",
        "Pixel (3, 4)",
    ):
        assert label in shown, label
    assert "radiance 0.518  ·  " + words.counts(small_tree()) in shown
    assert {"1  lamp", "2  sun"} <= set(shown)


def test_names_are_escaped():
    name = """<b a="1">&'"""
    nodes = []
    light(ray(nodes, target=[0, 1, 0], shape=name, bsdf=name), name, [1, 2, 3])
    document = drawing.to_svg(tree_of(nodes))
    assert "<b" not in document
    shown = texts(document)
    assert name in shown
    assert "1  " + name in shown
    titles = [element.text for element in ET.fromstring(document).iter(SVG + "title")]
    assert any(f"{name} ({name})" in title for title in titles)


def test_more_lights_than_fit_are_counted():
    shown = texts(drawing.to_svg(full_tree(2, lights=30)))
    assert shown.count("+19") == 3
    assert "and 20 more lights" in shown


def test_edges_are_as_wide_as_their_weight_and_coloured_by_kind():
    lines = list(ET.fromstring(drawing.to_svg(small_tree())).find(SVG + "g").iter(SVG + "line"))
    width = {kind: [] for kind in words.KINDS}
    for line in lines:
        for kind, look in words.KINDS.items():
            if line.get("stroke") == look.colour:
                width[kind].append(float(line.get("stroke-width")))
    assert {kind: len(found) for kind, found in width.items()} == {
        "eye": 1,
        "reflection": 2,
        "transmission": 2,
    }
    assert width["eye"][0] > width["transmission"][0] > width["transmission"][1] > width["reflection"][0]


@pytest.mark.parametrize("linear", [0, 0.002, 0.0031308, 0.18, 0.5, 1, 3, -1, np.nan])
def test_swatches_are_tone_mapped_as_pictures_are(linear):
    from whitted import tonemap

    expected = tonemap.tone_map(np.full((1, 1, 3), linear))[0, 0]
    assert svg.rgb_hex([linear] * 3) == "#" + bytes(expected).hex()


def test_plane_of_the_rays():
    rng = np.random.default_rng(0)
    side = rng.standard_normal((50, 3)) * [0.01, 1, 2]
    horizontal, vertical = planview.best_axes(side, [0, 0, 1])
    assert horizontal @ [0, 0, 1] == pytest.approx(1, abs=1e-3)
    assert vertical @ [0, 1, 0] == pytest.approx(1, abs=1e-3)
    above = rng.standard_normal((50, 3)) * [1, 0.01, 2]
    horizontal, vertical = planview.best_axes(above, [0, 0, 1])
    assert vertical @ [0, 0, 1] == pytest.approx(1, abs=1e-3)
    assert horizontal @ [-1, 0, 0] == pytest.approx(
        1, abs=1e-3
    )  # x to the left of one who looks along z, y up
    single = np.array([[0, 0, 0], [0, 0, 4.0]])
    axes = planview.best_axes(single, [0, 0, 1])
    assert axes == pytest.approx(np.array([[0, 0, 1], [0, 1, 0]]), abs=1e-9)
    assert np.isfinite(planview.best_axes(single[:1], [0, 1, 0])).all()
