"""Scalable Vector Graphics without a library: one function per kind of mark, all text escaped."""

from html import escape

FONT = "Helvetica, Arial, 'DejaVu Sans', sans-serif"
INK, FAINT, PAPER = "#222222", "#8a8a8a", "#ffffff"
CHARACTER_WIDTH = 0.58  # of the font size: the average of the sans-serif fonts above, on the wide side


def element(tag, *children, **attributes):
    """Return an element; ``_`` in a name stands for ``-``, floats are rounded, None is left out."""
    named = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escape(_value(value))}"'
        for name, value in attributes.items()
        if value is not None
    )
    return f"<{tag}{named}>{''.join(children)}</{tag}>" if children else f"<{tag}{named}/>"


def text(x, y, content, size=11, anchor="middle", halo=False, **attributes):
    """Return a line of text; ``halo`` keeps lines behind it away."""
    around = {"stroke": PAPER, "stroke_width": 4, "stroke_linejoin": "round", "paint_order": "stroke"}
    style = {"font_size": size, "text_anchor": anchor, "fill": INK} | (around if halo else {}) | attributes
    return element("text", escape(str(content)), x=x, y=y, **style)


def line(start, end, **attributes):
    """Return a straight line between two points (x, y)."""
    style = {"stroke": INK, "stroke_linecap": "round"} | attributes
    return element("line", x1=start[0], y1=start[1], x2=end[0], y2=end[1], **style)


def arrow(start, end, size=6.0, **attributes):
    """Return a line with a head of ``size`` at its end."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = max((dx * dx + dy * dy) ** 0.5, 1e-9)
    dx, dy = dx / length * size, dy / length * size
    points = [end, (end[0] - dx - dy / 2, end[1] - dy + dx / 2), (end[0] - dx + dy / 2, end[1] - dy - dx / 2)]
    head = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    shaft = line(start, (end[0] - dx * 0.8, end[1] - dy * 0.8), **attributes)
    return shaft + element("polygon", points=head, fill=attributes.get("stroke", INK))


def circle(x, y, radius, *children, **attributes):
    """Return a circle."""
    return element("circle", *children, cx=x, cy=y, r=radius, **attributes)


def text_width(content, size=11):
    """Estimate the width of a line of text, in the units of ``size``."""
    return CHARACTER_WIDTH * size * len(str(content))


def rgb_hex(rgb):
    """Return the sRGB colour, such as ``#7f7f7f``, of linear radiance (IEC 61966-2-1), clipped to 0..1.

    The formula stands here once more because colour-science takes a second to import.
    """
    clipped = [min(max(value, 0.0), 1.0) if value == value else 0.0 for value in rgb]
    encoded = [12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055 for v in clipped]
    return "#" + "".join(f"{int(255 * value + 0.5):02x}" for value in encoded)


def _value(value):
    return f"{value:.2f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)
