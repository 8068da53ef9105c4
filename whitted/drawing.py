"""The ray tree of a pixel as a drawing, as every course has it on the blackboard.

Whitted 1980 ([Whitted1980]), figures 2 and 3: the edges of the tree are the rays, its nodes the points that
they meet. `whitted.words` describes the tree. Left out: the shapes of the surfaces.
"""

from collections import Counter

from whitted import planview, svg, tidy, words

RADIUS, LEVEL, GAP = 15.0, 104.0, 16.0  # of a node; between the levels; between neighbours
ALONG = 0.7  # of an edge, where its label is
BELOW = RADIUS + 18.0  # a node with its label reaches so far down
LIGHTS = (3, 12)  # in one column; drawn at a node at most
LABEL = 14  # characters of a surface's name
PANEL = (440.0, 360.0)  # width and height of the view of the rays in space
SUN = ("#ffe27a", "#b98900")  # fill and line
LIT, BLOCKED = "#e0a100", "#a5a5a5"
PALETTE = ("#4e79a7", "#f28e2b", "#59a14f", "#b07aa1", "#9c755f", "#edc948", "#76b7b2", "#e15759", "#ff9da7")


def to_svg(tree):
    """Return the tree as a drawing, an SVG document that needs no other file.

    On the left the tree: a node is filled with what it contributes to the pixel, an edge is the wider the
    more its ray weighs. On the right the same rays in space.
    """
    style = _Style(tree)
    placed, size = place(tree)
    left, top, margin = 24.0, 86.0, 24.0
    room = max(size[0], 300.0)
    column, shift = left + room + margin, left + (room - size[0]) / 2
    legend, legend_height = _legend(style, column, top + PANEL[1] + 30)
    width = column + PANEL[0] + margin
    height = max(top + size[1], top + PANEL[1] + 30 + legend_height) + margin
    body = [
        svg.element("title", svg.escape("Ray tree of pixel ({}, {})".format(*tree.pixel))),
        svg.element("rect", width=width, height=height, fill=svg.PAPER),
        _heading(tree, left, 24.0),
        svg.element("g", *_tree(tree, placed, style), transform=f"translate({shift:.1f} {top:.1f})"),
        planview.draw(tree, column, top, PANEL, style),
        legend,
    ]
    document = svg.element(
        "svg",
        *body,
        xmlns="http://www.w3.org/2000/svg",
        width=width,
        height=height,
        viewBox=f"0 0 {width:.1f} {height:.1f}",
        font_family=svg.FONT,
    )
    return document + "\n"


def place(tree):
    """Lay out the nodes of the tree.

    Returns:
        a dict from id to ``(x, y, left, top, right, bottom)``, the node's centre and the box of all that
        belongs to it; and the width and height of the whole.
    """
    nodes = {node["id"]: node for node in tree.nodes}
    reach = {key: _reach(node) for key, node in nodes.items()}
    spaced = {key: (left + GAP / 2, right + GAP / 2) for key, (left, right) in reach.items()}
    xs, width = tidy.columns(tree.nodes[0]["id"], words.children_of(tree), spaced)
    ys = _heights(tree, xs)
    placed = {}
    for key, x in xs.items():
        y, (left, right) = ys[nodes[key]["depth"]], reach[key]
        placed[key] = (x, y, x - left, y - RADIUS, x + right, y + BELOW)
    return placed, (width, max(ys.values()) + BELOW)


class _Style:
    """What the two panels share: the colours of the surfaces and the numbers of the lights."""

    def __init__(self, tree):
        shapes = dict.fromkeys(node["shape"] for node in tree.nodes)
        lights = dict.fromkeys(shadow["emitter"] for node in tree.nodes for shadow in node["shadow"])
        self.surfaces = {shape: PALETTE[i % len(PALETTE)] for i, shape in enumerate(shapes)}
        self.lights = {light: i + 1 for i, light in enumerate(lights)}

    @staticmethod
    def stroke_width(throughput):
        return 0.8 + 2.7 * min(max(throughput), 1.0) ** 0.5

    @staticmethod
    def shadow_style(shadow):
        if shadow["transmittance"] > 0:
            return {"stroke": LIT, "stroke_width": 1.6, "stroke_opacity": 0.3 + 0.7 * shadow["transmittance"]}
        return {"stroke": BLOCKED, "stroke_width": 1.2, "stroke_dasharray": "3 3"}


def _heading(tree, x, y):
    fill = svg.rgb_hex(tree.radiance)
    swatch = svg.element("rect", x=x, y=y, width=38, height=38, rx=4, fill=fill, stroke=svg.INK)
    name = "Pixel ({}, {})".format(*tree.pixel)
    title = svg.text(x + 50, y + 16, name, size=19, anchor="start", font_weight=600)
    facts = f"radiance {words.colour(tree.radiance)}  ·  {words.counts(tree)}"
    return swatch + title + svg.text(x + 50, y + 35, facts, size=12, anchor="start", fill="#555555")


def _tree(tree, placed, style):
    """Return the marks of the tree: edges, then their labels, then the nodes."""
    edges, labels, marks = [], [], []
    for node in tree.nodes:
        x, y, *_ = placed[node["id"]]
        kind = words.KINDS[node["kind"]]
        if node["parent"] is None:
            start = (x, y - LEVEL + RADIUS)
            marks.append(planview.eye_mark(*start))
        else:
            start = (placed[node["parent"]][0], placed[node["parent"]][1] + BELOW)
        end = (x, y - RADIUS)
        dash = "2 4" if node["dropped"] else None
        thickness = style.stroke_width(node["throughput"])
        edges.append(svg.line(start, end, stroke=kind.colour, stroke_width=thickness, stroke_dasharray=dash))
        along = [a + ALONG * (b - a) for a, b in zip(start, end, strict=True)]
        labels.append(_label(*along, _weight(node), kind.colour))
        marks += _shadows(node, x, y, style)
        marks.append(_node(node, x, y, style))
    return edges + labels + marks


def _label(x, y, content, colour):
    """Return a text in a gap of the line through its place."""
    width = svg.text_width(content, 10)
    gap = svg.element("rect", x=x - width / 2, y=y - 7, width=width, height=14.0, fill=svg.PAPER)
    return gap + svg.text(x, y + 3.5, content, size=10, fill=colour)


def _node(node, x, y, style):
    """Return a node: a disc in the colour of its contribution, ringed in the colour of its surface."""
    tip = svg.element("title", svg.escape(_tip(node)))
    if node["dropped"]:
        side = 5.5
        cross = "".join(
            svg.line((x - side, y - s * side), (x + side, y + s * side), stroke=svg.FAINT, stroke_width=2)
            for s in (1, -1)
        )
        ring = svg.circle(x, y, RADIUS, fill=svg.PAPER, stroke=svg.FAINT, stroke_width=1.5)
        name = svg.text(x, y + RADIUS + 13, words.REASONS[node["dropped"]], size=10.5, fill=svg.FAINT)
        return svg.element("g", tip, ring, cross, name)
    escaped = node["position"] is None
    ring = svg.circle(
        x,
        y,
        RADIUS,
        fill=svg.rgb_hex(node["contribution"]),
        stroke=svg.FAINT if escaped else style.surfaces[node["shape"]],
        stroke_width=3,
        stroke_dasharray="4 3" if escaped else None,
    )
    is_bright = sum(node["contribution"]) > 0.6
    number = svg.text(x, y + 4, node["id"], size=11, fill=svg.INK if is_bright else svg.PAPER)
    name = svg.text(x, y + RADIUS + 13, _name(node), size=10.5, fill=svg.FAINT if escaped else svg.INK)
    return svg.element("g", tip, ring, number, name)


def _shadows(node, x, y, style):
    """Return a node's shadow rays: lines to suns with their lights' numbers, in columns at its right."""
    shadows, marks = node["shadow"], []
    shown = len(shadows) if len(shadows) <= LIGHTS[1] else LIGHTS[1] - 1
    for i in range(min(len(shadows), LIGHTS[1])):
        row, column = i % LIGHTS[0], i // LIGHTS[0]
        rows = min(LIGHTS[0], len(shadows) - column * LIGHTS[0])
        end = (x + RADIUS + 26 + 30 * column, y + 17.0 * (row - (rows - 1) / 2))
        if i == shown:
            marks.append(svg.text(end[0], end[1] + 3, f"+{len(shadows) - shown}", size=10))
            break
        shadow = shadows[i]
        fill = SUN if shadow["transmittance"] > 0 else ("#eeeeee", BLOCKED)
        tip = svg.element("title", svg.escape(words.light(shadow)[0]))
        ray = svg.line((x, y), end, **style.shadow_style(shadow)) if column == 0 else ""
        number = svg.text(end[0] + 10, end[1] + 3, style.lights[shadow["emitter"]], size=8.5, anchor="start")
        marks.append(svg.element("g", tip, ray, planview.light_mark(*end, *fill), number))
    return marks


def _legend(style, x, y):
    """Return the legend, two columns wide, and its height."""

    def ray(colour, **more):
        return lambda x, y: svg.line((x, y), (x + 30, y), stroke=colour, **({"stroke_width": 2.5} | more))

    def ring(colour, dash=None):
        return lambda x, y: svg.circle(
            x + 15, y, 7, fill="#dddddd", stroke=colour, stroke_width=2.5, stroke_dasharray=dash
        )

    def sun(x, y):
        return planview.light_mark(x + 15, y, *SUN)

    entries = [(ray(kind.colour), f"{kind.letter}  {kind.words}") for kind in words.KINDS.values()]
    entries.append((ray(svg.FAINT, stroke_dasharray="2 4"), "not traced"))
    entries.append((ray(LIT, stroke_width=1.6), "shadow ray, lit"))
    entries.append((ray(BLOCKED, stroke_dasharray="3 3", stroke_width=1.2), "shadow ray, blocked"))
    entries.append((ring(PALETTE[0]), "filled: contribution; ring: surface"))
    entries.append((ring(svg.FAINT, "4 3"), "escaped from the scene"))
    lights = list(style.lights.items())
    for name, number in lights[:10]:
        entries.append((sun, f"{number}  {_short(name, 26)}"))
    if len(lights) > 10:
        entries.append((lambda x, y: "", f"and {len(lights) - 10} more lights"))
    rows = (len(entries) + 1) // 2
    marks = []
    for i, (mark, label) in enumerate(entries):
        at = (x + PANEL[0] / 2 * (i // rows), y + 21.0 * (i % rows))
        marks += [mark(*at), svg.text(at[0] + 40, at[1] + 4, label, size=11, anchor="start")]
    return "".join(marks), 21.0 * rows


def _heights(tree, centres):
    """Return the height of each level: wide fans of edges get more room, so that they stay apart."""
    span = Counter()
    for node in tree.nodes:
        if node["parent"] is not None:
            span[node["depth"]] = max(span[node["depth"]], abs(centres[node["id"]] - centres[node["parent"]]))
    heights, y = {}, LEVEL
    for depth in range(max(node["depth"] for node in tree.nodes) + 1):
        y += (LEVEL + min(0.12 * span[depth], 1.5 * LEVEL)) if depth else 0.0
        heights[depth] = y
    return heights


def _reach(node):
    """Return how far a node reaches to the left and to the right of its centre."""
    label = svg.text_width(_weight(node), 10) / ALONG  # narrower there than at the nodes
    half = max(RADIUS + 2, svg.text_width(_name(node), 10.5) / 2, label / 2)
    columns = -(-min(len(node["shadow"]), LIGHTS[1]) // LIGHTS[0])
    return half, max(half, RADIUS + 30 * columns + 18) if columns else half


def _weight(node):
    return f"{words.KINDS[node['kind']].letter} {words.number(max(node['throughput']))}"


def _name(node):
    if node["dropped"]:
        return words.REASONS[node["dropped"]]
    return "escaped" if node["position"] is None else _short(node["shape"] or "unnamed", LABEL)


def _short(name, length):
    return name if len(name) <= length else name[: length - 1] + "…"


def _tip(node):
    """Return what a browser shows where the pointer rests on a node."""
    material = f" ({node['bsdf']})" if node["bsdf"] else ""
    meets, distance, contribution = words.outcome(node)
    return (
        f"{node['id']}: {node['kind']}, weight {words.colour(node['throughput'])}\n{meets}{material}"
        + (f"\ndistance {distance}" if distance else "")
        + (f"\ncontribution {contribution}" if contribution else "")
    )
