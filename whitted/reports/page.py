"""A study's report: one HTML file that needs nothing else, with plots, tables and a viewer of the pictures."""

import base64
import json
from datetime import datetime
from importlib.resources import files as resources

import numpy as np

from whitted import files, tonemap
from whitted.reports import pictures, plots
from whitted.studies.analysis import analyse
from whitted.studies.store import Store
from whitted.studies.study import Study

DASH = "\N{EN DASH}"  # for what is no number
PICTURES = 40  # at most in the viewer: of each method those of some steps of the ladder
TITLES = {
    "pixel": "the place within the pixel",
    "lens": "the place on the lens",
    "time": "the time within the exposure",
    "light": "the light and the place on it",
    "gloss": "the direction of rough reflection or refraction",
    "hemisphere": "the direction of diffuse reflection",
    "branch": "the choice between lobes, and roulette",
    "wavelength": "the wavelengths",
}


def write(folder, path, errors=()):
    """Write the report of a study's folder.

    Args:
        folder: the study's.
        path: of the HTML file.
        errors: relative RMSEs of which the cheapest setting is told, beside the usual ones.

    Raises:
        UsageError: there is no study, nothing in it is finished, or the file can't be written.
    """
    files.check_writable(path)
    files.write(path, render(folder, errors))


def render(folder, errors=()):
    """Return the report of a study's folder as HTML; the arguments are those of `write`.

    Raises:
        UsageError: there is no study.
    """
    import jinja2

    study = Study(folder)
    with Store(folder) as store:
        scenes = analyse(store, errors)
        environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
        environment.filters |= {"number": number, "percent": percent, "seconds": seconds}
        template = environment.from_string(_asset("report.html"))
        entries, styles = _entries(store, scenes), plots.styles_of(scenes)
        return template.render(
            specification=study.specification,
            folder=study.folder.name,
            count=study.count(),
            date=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
            scenes=[_section(store, i, scene, styles) for i, scene in enumerate(scenes)],
            machines=[_machine(row) for row in store.query("SELECT * FROM environments")],
            failures=store.query("SELECT DISTINCT message FROM cells WHERE status = 'failed' AND wanted = 1"),
            titles=TITLES,
            viewer=pictures.place() if entries else "",
            viewer_data=pictures.data(entries) if entries else "",
            scripts=[_asset("plotly.js"), _asset("report.js")],
            viewer_script=pictures.script(),
            style=_asset("report.css"),
            viewer_style=pictures.style(),
        )


def number(value):
    """Return a number with three significant digits; what is no number is a dash."""
    if value is None or not np.isfinite(value):
        return DASH
    return f"{value:.3g}"


def percent(value):
    """Return a share in percent."""
    return DASH if value is None or not np.isfinite(value) else f"{100 * value:.3g} %"


def seconds(value):
    """Return seconds with a unit that suits them."""
    if value is None or not np.isfinite(value):
        return DASH
    return f"{value:.3g} s" if value >= 0.1 else f"{1000 * value:.3g} ms"


def _asset(name):
    return resources("whitted.reports").joinpath("assets", name).read_text("utf-8")


def _machine(row):
    return row | {"versions": json.loads(row["versions"])}


def _section(store, number, scene, styles):
    """What the template needs of a scene."""
    timed = all(ladder.seconds is not None for ladder in scene.ladders.values())
    figures = [("errors-spp", "RMSE against samples per pixel", plots.errors(scene, "spp", styles))]
    if timed:
        figures.insert(0, ("errors-seconds", "RMSE against seconds", plots.errors(scene, "seconds", styles)))
    return {
        "id": f"scene-{number}",
        "scene": scene,
        "timed": timed,
        "figures": [
            {"id": f"{name}-{number}", "title": title, "json": _json(figure), "text": _text(scene)}
            for name, title, figure in figures
        ],
        "shares": _shares_figure(number, scene),
        "noise": [_false_colours(store, name, rows) for name, rows in scene.shares.items()],
        "rows": [_row(name, ladder) for name, ladder in scene.ladders.items()],
        "headline": _headline(scene, timed),
        "colours": {name: style[0] for name, style in styles.items()},
    }


def _row(name, ladder):
    """The data of a method's curve, for people who don't see the plot."""
    band = ladder.curve_of_samples.band()
    times = [None] * len(ladder.spp) if ladder.seconds is None else ladder.curve.costs()
    root = [np.sqrt(np.maximum(v, 0)) for v in (band.value, band.low, band.high)]
    steps = zip(ladder.spp, times, *root, ladder.told, strict=True)
    return {
        "name": name,
        "steps": list(steps),
        "metrics": {n: v[:, -1].mean() for n, v in ladder.metrics.items()},
    }


def _headline(scene, timed):
    """The main finding in a sentence, or nothing."""
    known = {name: found for name, found in scene.ratios.items() if np.isfinite(found.low)}
    if not known:
        return ""
    best = max(known, key=lambda name: known[name].value)
    ratio = known[best]
    at = f"in {seconds(scene.cost)} of kernels" if timed else f"at {number(scene.cost)} samples per pixel"
    if ratio.low <= 1:
        return (
            f"{at[0].upper()}{at[1:]} none is shown to have a lower mean squared error than {scene.baseline}."
        )
    return (
        f"{at[0].upper()}{at[1:]}, {best} has a mean squared error {ratio.value:.3g} times lower than"
        f" {scene.baseline}, 95 % interval [{ratio.low:.3g}, {ratio.high:.3g}]."
    )


def _text(scene):
    """A plot in words."""
    ends = [
        f"{name}: from {number(np.sqrt(max(ladder.errors[:, 0].mean(), 0)))} at {ladder.spp[0]}"
        f" to {number(np.sqrt(max(ladder.errors[:, -1].mean(), 0)))} at {ladder.spp[-1]} samples per pixel"
        for name, ladder in scene.ladders.items()
    ]
    return (
        f"Root mean square errors on {scene.label}. " + "; ".join(ends) + ". The table below has all numbers."
    )


def _shares_figure(number, scene):
    figure = plots.shares(scene)
    if figure is None:
        return None
    words = [
        f"{name}: " + ", ".join(f"{row['effect']} {percent(row['total'])}" for row in rows)
        for name, rows in scene.shares.items()
    ]
    text = f"Shares of the variance on {scene.label}, interactions included. " + "; ".join(words) + "."
    return {
        "id": f"shares-{number}",
        "title": "Share of the variance by effect",
        "json": _json(figure),
        "text": text,
    }


def _false_colours(store, name, rows):
    """The picture of what makes the noise, as a data URL, with its title."""
    picture = store.picture(rows[0]["picture"])
    data = base64.b64encode(tonemap.encode_png(picture.rgb)).decode()
    return {
        "name": name,
        "url": f"data:image/png;base64,{data}",
        "width": picture.width,
        "height": picture.height,
    }


def _json(figure):
    return figure.to_json().replace("<", "\\u003c")


def _entries(store, scenes):
    """The pictures of the viewer: of each scene the reference, and of its methods some steps of the ladder."""
    wanted = sum(1 + len(scene.ladders) for scene in scenes)
    steps = max((PICTURES - wanted) // max(wanted - len(scenes), 1) + 1, 1)
    return [entry for number, scene in enumerate(scenes) for entry in _of_scene(store, number, scene, steps)]


def _of_scene(store, number, scene, steps):
    picture = store.picture(scene.reference["picture"])
    reference = f"s{number}-reference"
    channels = next(iter(scene.ladders.values())).pictures[0][0]
    count = store.pixels(channels).shape[-1]
    entries = []
    for i, (name, ladder) in enumerate(scene.ladders.items()):
        columns = np.unique(np.linspace(len(ladder.spp) - 1, 0, steps).round().astype(int))[::-1]
        for k in columns:
            replicates = np.stack([store.pixels(row[k]) for row in ladder.pictures])
            entries.append(
                pictures.Entry(
                    id=f"s{number}-m{i}-{ladder.spp[k]}",
                    name=name,
                    group=scene.label,
                    radiance=replicates[0],
                    stderr=replicates.std(axis=0, ddof=1) if len(replicates) > 1 else None,
                    text=f"{scene.label} by {name} with {ladder.spp[k]} samples per pixel",
                    reference=reference,
                    spp=int(ladder.spp[k]),
                    seconds=None if ladder.seconds is None else float(ladder.curve.costs()[k]),
                )
            )
    truth = pictures.Entry(
        id=reference,
        name="reference",
        group=scene.label,
        radiance=picture.rgb[..., :count],
        stderr=picture.stderr[..., :count],
        text=f"{scene.label}, the reference",
        spp=scene.reference["spp"] * scene.reference["replicates"],
    )
    return [*entries[:1], truth, *entries[1:]]
