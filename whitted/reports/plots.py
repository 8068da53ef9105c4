"""The plots of a report, as Plotly figures: error against time and samples, and what makes the noise.

Each method has a colour [OkabeIto2008], a marker and a dash of its own, so that colours aren't needed to tell them
apart. Text and lines take the page's colours by its script. Left out: drawing; that is for the browser.
"""

import math

import numpy as np

PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6d31", "#7f7f7f")
MARKERS = ("circle", "square", "diamond", "triangle-up", "cross", "x", "star", "hexagon")
DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot", "solid", "dash")
EFFECTS = {
    "pixel": "#56b4e9",
    "lens": "#0072b2",
    "time": "#8c6d31",
    "light": "#e69f00",
    "gloss": "#cc79a7",
    "hemisphere": "#009e73",
    "branch": "#d55e00",
    "wavelength": "#7f7f7f",
    "interaction": "#bbbbbb",
}
HEIGHT = 420


def styles_of(scenes):
    """Return colour, marker and dash of each method by its label: the same on all scenes."""
    labels = dict.fromkeys(label for scene in scenes for label in scene.ladders)
    return {
        label: tuple(of[number % len(of)] for of in (PALETTE, MARKERS, DASHES))
        for number, label in enumerate(labels)
    }


def errors(scene, over, styles):
    """Return the figure of the RMSE of all methods on a scene, with its 95 % bands.

    Args:
        scene: `whitted.studies.analysis.Scene`.
        over: ``seconds`` or ``spp``.
        styles: from `styles_of`.
    """
    import plotly.graph_objects as go

    figure = go.Figure()
    for name, ladder in scene.ladders.items():
        if over == "seconds" and ladder.seconds is None:
            continue
        x = ladder.spp if over == "spp" else ladder.curve.costs()
        band = ladder.curve_of_samples.band()
        y, low, high = (np.sqrt(np.maximum(v, 0)) for v in (band.value, band.low, band.high))
        colour, marker, dash = styles[name]
        shown = y > 0
        figure.add_scatter(
            x=_plain(np.concatenate([x[shown], x[shown][::-1]])),
            y=_plain(np.concatenate([_bounded(high, y, 3)[shown], _bounded(low, y, 1 / 3)[shown][::-1]])),
            mode="lines",
            fill="toself",
            fillcolor=_translucent(colour),
            line={"width": 0},
            hoverinfo="skip",
            showlegend=False,
            legendgroup=name,
        )
        figure.add_scatter(
            x=_plain(x[shown]),
            y=_plain(y[shown]),
            name=name,
            legendgroup=name,
            mode="lines+markers",
            line={"color": colour, "dash": dash, "width": 2},
            marker={"symbol": marker, "size": 9},
            customdata=[int(n) for n in ladder.spp[shown]],
            hovertemplate="%{fullData.name}<br>%{customdata} spp<br>RMSE %{y:.3g}"
            + ("<br>%{x:.3g} s" if over == "seconds" else "")
            + "<extra></extra>",
        )
    floor = math.sqrt(scene.reference["variance"])
    figure.add_shape(
        type="line", xref="paper", x0=0, x1=1, y0=floor, y1=floor, line={"dash": "dot", "width": 1}
    )
    figure.add_annotation(
        xref="paper", x=1, y=math.log10(floor), text="error of the reference", showarrow=False, yanchor="bottom",
        xanchor="right", font={"size": 11},
    )  # fmt: skip
    title = "seconds of kernels" if over == "seconds" else "samples per pixel"
    figure.update_layout(_layout(_axis(title), _axis("RMSE")))
    return figure


def shares(scene):
    """Return the figure of the noise shares of each method on a scene: first order, and interaction; or None."""
    import plotly.graph_objects as go

    if not scene.shares:
        return None
    effects = [
        effect
        for effect in EFFECTS
        if effect in {r["effect"] for rows in scene.shares.values() for r in rows}
    ]
    figure = go.Figure()
    names = list(scene.shares)
    for effect in effects:
        rows = [next((r for r in scene.shares[name] if r["effect"] == effect), None) for name in names]
        firsts = [max(row["first"], 0) if row else 0 for row in rows]
        figure.add_bar(
            y=names,
            x=firsts,
            name=effect,
            orientation="h",
            marker={"color": EFFECTS[effect]},
            customdata=[
                [row["total"], row["total_low"], row["total_high"]] if row else [0, 0, 0] for row in rows
            ],
            hovertemplate=f"{effect}<br>alone %{{x:.1%}}<br>with interactions %{{customdata[0]:.1%}}"
            " [%{customdata[1]:.1%}, %{customdata[2]:.1%}]<extra></extra>",
        )
    rest = [max(1 - sum(max(r["first"], 0) for r in scene.shares[name]), 0) for name in names]
    figure.add_bar(
        y=names,
        x=rest,
        name="interaction",
        orientation="h",
        marker={"color": EFFECTS["interaction"]},
        hovertemplate="of several together<br>%{x:.1%}<extra></extra>",
    )
    layout = _layout(
        {"range": [0, 1], "tickformat": ".0%", "title": "share of the variance"},
        {"autorange": "reversed", "automargin": True},
    )
    figure.update_layout(layout, barmode="stack", legend_traceorder="normal", height=120 + 46 * len(names))
    return figure


def _layout(x, y):
    return {
        "xaxis": x,
        "yaxis": y,
        "height": HEIGHT,
        "margin": {"l": 70, "r": 15, "t": 15, "b": 55},
        "legend": {"orientation": "h", "yanchor": "bottom", "y": 1.02},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": "system-ui, sans-serif", "size": 13},
        "template": "none",
    }


def _axis(title):
    return {"type": "log", "title": title, "exponentformat": "power", "showgrid": True, "dtick": 1}


def _bounded(bound, value, factor):
    """A bound as far as it can be drawn: infinite and missing ones end at a factor of the value."""
    limit = factor * value
    known = np.isfinite(bound) & (bound > 0)
    return (
        np.where(known, bound, limit) if factor < 1 else np.where(known, np.minimum(bound, 10 * value), limit)
    )


def _translucent(colour):
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.18)"


def _plain(values):
    return [float(value) for value in values]
