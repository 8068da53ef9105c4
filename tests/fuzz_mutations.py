"""Random changes to the XML of a scene, each of which a seed makes again."""

import random
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

NUMBERS = (
    *(
        "0",
        "-0",
        "1e-42",
        "-1e-42",
        "1e-20",
        "1e-3",
        "0.5",
        "1",
        "2",
        "-1",
        "-7",
        "1000",
        "1e17",
        "1e30",
        "-1e30",
    ),
    *("2147483647", "-2147483648", "99999999999999999999", "nan", "inf"),
)
NUMERIC = ("value", "x", "y", "z", "angle", "origin", "target", "up")
TYPES = {
    "bsdf": "diffuse dielectric thindielectric roughdielectric conductor roughconductor plastic roughplastic phong"
    " pplastic principled principledthin hair null mask twosided blendbsdf bumpmap normalmap",
    "shape": "sphere cylinder disk rectangle cube",
    "emitter": "point spot directional directionalarea area constant projector sunsky envmap",
    "texture": "checkerboard bitmap volume mesh_attribute",
    "rfilter": "box tent gaussian mitchell catmullrom lanczos",
    "sampler": "independent stratified multijitter orthogonal ldsampler owen_sobol zsobol",
    "sensor": "perspective thinlens orthographic radiancemeter irradiancemeter distant",
    "film": "hdrfilm specfilm",
    "integrator": "whitted distribution path direct",
}
TYPES = {kind: names.split() for kind, names in TYPES.items()}


@dataclass
class Mutant:
    """A mutated scene: what it was, how it is rendered, and what was done to it."""

    seed: int
    scene: str
    text: str
    spp: int
    is_slow: bool
    changes: list = field(default_factory=list)


def mutant(seed, texts):
    """Return the ``Mutant`` of a seed; ``texts`` are the ``scenes()``."""
    dice = random.Random(seed)
    name = dice.choice(sorted(texts))
    root = ET.fromstring(re.sub(r"<!--.*?-->", "", texts[name], flags=re.DOTALL))
    set_integrator(dice, root)
    changes = []
    while not changes or dice.random() < 0.2:
        (change,) = dice.choices(list(MUTATIONS), MUTATIONS.values())
        if made := change(dice, root):
            changes.append(made)
    text = ET.tostring(root, encoding="unicode")
    return Mutant(seed, name, text, dice.choice((1, 1, 2)), chooses_effects(root), changes)


def set_integrator(dice, root):
    """Choose the integrator; one in ten times `distribution` may choose its effects."""
    name = dice.choice(("whitted", "distribution"))
    for element in root.iterfind("default"):
        if element.get("name") == "integrator":
            element.set("value", name)
    parameters = {
        "distribution": ("integer", "rr_depth", "5"),
        "whitted": ("float", "min_contribution", "0.001"),
    }
    tag, parameter, value = parameters[name]
    ET.SubElement(root.find("integrator"), tag, name=parameter, value=value)
    if name == "distribution" and dice.random() < 0.9:
        ET.SubElement(root.find("integrator"), "string", name="effects", value="all")


def chooses_effects(root):
    """Whether `distribution` may choose its effects, for which many kernels are compiled."""
    element = root.find("integrator")
    if element is None:
        return True
    default = root.find("default[@name='integrator']")
    name = element.get("type", "").replace("$integrator", "" if default is None else default.get("value", ""))
    return name != "whitted" and all(part.get("name") != "effects" for part in element)


def change_number(dice, root):
    """One number becomes one of ``NUMBERS``; numbers in lists and matrices, of which there are most, half as often."""
    elements = list(root.iter())
    if dice.random() < 0.5:
        elements = [element for element in elements if element.tag in ("float", "integer", "default")]
    places = [
        (element, name, match)
        for element in elements
        for name in NUMERIC
        if name in element.attrib and element.tag != "string"
        for match in re.finditer(r"[-+\d.][-+\d.eE]*", element.attrib[name])
        if re.search(r"\d", match[0])
    ]
    if not places:
        return None
    element, name, match = dice.choice(places)
    old, number = element.get(name), dice.choice(NUMBERS)
    element.set(name, old[: match.start()] + number + old[match.end() :])
    return f"{label(element)}: {name}={old!r} became {element.get(name)!r}"


def drop_node(dice, root):
    parent, node = pick(dice, root)
    parent.remove(node)
    return f"{label(node)} of {label(parent)} dropped"


def double_node(dice, root):
    parent, node = pick(dice, root)
    copy = ET.fromstring(ET.tostring(node))
    if dice.random() < 0.7:
        for element in copy.iter():
            if element.tag != "ref":
                element.attrib.pop("id", None)
    parent.insert(list(parent).index(node), copy)
    return f"{label(node)} of {label(parent)} doubled"


def nest_node(dice, root):
    parent, node = pick(dice, root)
    inside = set(node.iter())
    goals = [element for element in root.iter() if element not in inside and element is not parent]
    if not goals:
        return None
    goal = dice.choice(goals)
    parent.remove(node)
    goal.append(node)
    return f"{label(node)} of {label(parent)} put into {label(goal)}"


def drop_attribute(dice, root):
    element = dice.choice([element for element in root.iter() if element.attrib])
    name = dice.choice(sorted(element.attrib))
    value = element.attrib.pop(name)
    return f"{element.tag} lost {name}={value!r}"


def swap_attributes(dice, root):
    """Two elements swap the values of an attribute, mostly elements of one kind."""
    one = dice.choice([element for element in root.iter() if element.attrib])
    name = dice.choice(sorted(one.attrib))
    alike = dice.random() < 0.8
    others = [e for e in root.iter() if e is not one and name in e.attrib and (e.tag == one.tag or not alike)]
    if not others:
        return None
    other = dice.choice(others)
    was = label(one), label(other)
    one.attrib[name], other.attrib[name] = other.attrib[name], one.attrib[name]
    return f"{was[0]} and {was[1]} swapped {name}"


def break_reference(dice, root):
    places = [
        (e, name) for e in root.iter() for name in ("id", "value") if name == "id" or "$" in e.get(name, "")
    ]
    places = [(e, name) for e, name in places if e.tag == "ref" or name == "value"]
    if not places:
        return None
    element, name = dice.choice(places)
    ids = sorted(e.get("id") for e in root.iter() if e.get("id") and e.tag != "ref")
    value = "none" if dice.random() < 0.5 or not ids else dice.choice(ids)
    element.set(name, value if name == "id" else f"${value}")
    return f"{element.tag} refers to {value!r}"


def change_type(dice, root):
    elements = [element for element in root.iter() if element.tag in TYPES and element.get("type")]
    if not elements:
        return None
    element = dice.choice(elements)
    old = element.get("type")
    element.set("type", dice.choice(TYPES[element.tag]))
    return f"{element.tag} of type {old!r} became {element.get('type')!r}"


MUTATIONS = {
    change_number: 70,
    drop_node: 8,
    double_node: 6,
    nest_node: 4,
    drop_attribute: 3,
    swap_attributes: 5,
    break_reference: 2,
    change_type: 4,
}


def pick(dice, root):
    """A random element with its parent."""
    return dice.choice([(parent, node) for parent in root.iter() for node in parent])


def label(element):
    names = " ".join(
        f"{name}={element.get(name)!r}" for name in ("type", "name", "id") if name in element.attrib
    )
    return f"<{element.tag}{' ' * bool(names)}{names}>"
