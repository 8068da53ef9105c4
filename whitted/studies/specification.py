"""What a study is made of, as its TOML file, a dict or a `Specification` says; every mistake is one line.

A file has the fields of `Specification` at its top level. The tables ``[small]`` and ``[paper]`` hold what differs
between the sizes. Left out: ranges of other parameters than samples per pixel; list the integrators instead.
"""

import os
import tomllib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from whitted.errors import UsageError, nearest
from whitted.stats.metrics import METRICS

SIZES = ("small", "paper")
SUFFIX = ".toml"
LARGEST = 16384  # pixels of a side

Count = Annotated[int, Field(strict=True, ge=1)]
Side = Annotated[int, Field(strict=True, ge=1, le=LARGEST)]
Spp = Annotated[int, Field(strict=True, ge=1, le=1 << 24)]
Name = Annotated[str, Field(strict=True, min_length=1)]
Value = Annotated[bool, Field(strict=True)] | int | float | str


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class SceneEntry(_Model):
    """A scene of the study.

    Attributes:
        scene: a path, relative to the study's file, or the name of a shipped scene.
        name: how it is called; by default the scene's name.
        width, height: pixels; None takes the scene's own, or the study's.
        define: the scene's parameters, as ``-D`` sets them.
        sensor: the sensor's number.
    """

    scene: Name
    name: Name | None = None
    width: Side | None = None
    height: Side | None = None
    define: dict[str, Value] = {}
    sensor: Annotated[int, Field(strict=True, ge=0)] = 0

    @property
    def label(self):
        """How the scene is called."""
        return self.name or Path(self.scene).stem


class IntegratorEntry(_Model):
    """An integrator of the study: ``NAME[:key=value,...]`` or a dict, and how it is called."""

    integrator: Name | dict
    name: Name | None = None

    @property
    def label(self):
        """How the integrator is called."""
        spec = self.integrator
        return self.name or (spec if isinstance(spec, str) else str(spec.get("type", "?")))


class Reference(_Model):
    """What errors are taken against: the mean of independent renders.

    Attributes:
        integrator: as in `IntegratorEntry`.
        sampler: of Mitsuba's integrators.
        spp: samples per pixel of each render.
        replicates: how many there are, 2 or more, so that its error is known.
    """

    integrator: Name | dict
    sampler: Name = "multijitter"
    spp: Spp
    replicates: Annotated[int, Field(strict=True, ge=2, le=1024)] = 8


class Specification(_Model):
    """A study.

    Attributes:
        title, description: text for the report.
        scenes, integrators: at least one of each; text alone stands for the entry with that ``scene`` or
            ``integrator``.
        samplers: names of Mitsuba samplers, for Mitsuba's integrators; ours have sequences of their own.
        effects: ``auto``, ``all`` or names joined by ``+``, for ``distribution``; other integrators have no choice.
        spp: the ladder of samples per pixel.
        replicates: independent renders of each setting, 2 or more.
        timed: how many of these run alone on their machine, so that their seconds count; None: all.
        metrics: names of error metrics, see `whitted.stats.metrics.METRICS`.
        reference: `Reference`.
        width, height: pixels of all scenes that name none.
        shares: evaluations with which noise shares are measured for our integrators; 0: not at all.
        seed: of everything.
        time: seconds after which no further render begins; None: no limit.
        variant: of Mitsuba.
    """

    title: str = ""
    description: str = ""
    scenes: Annotated[tuple[SceneEntry, ...], Field(min_length=1)]
    integrators: Annotated[tuple[IntegratorEntry, ...], Field(min_length=1)]
    samplers: Annotated[tuple[Name, ...], Field(min_length=1)] = ("independent",)
    effects: Annotated[tuple[Name, ...], Field(min_length=1)] = ("auto",)
    spp: Annotated[tuple[Spp, ...], Field(min_length=1)]
    replicates: Annotated[int, Field(strict=True, ge=2, le=1024)] = 8
    timed: Annotated[int, Field(strict=True, ge=0)] | None = None
    metrics: Annotated[tuple[Name, ...], Field(min_length=1)] = ("mse", "rel_mse")
    reference: Reference
    width: Side | None = None
    height: Side | None = None
    shares: Annotated[int, Field(strict=True, ge=0, le=4096)] = 0
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    time: Annotated[float, Field(gt=0)] | None = None
    variant: Literal["llvm_ad_rgb", "llvm_ad_mono", "llvm_ad_spectral", "cuda_ad_rgb"] = "llvm_ad_rgb"

    @field_validator("scenes", "integrators", mode="before")
    @classmethod
    def _entries(cls, value, info):
        key = "scene" if info.field_name == "scenes" else "integrator"
        entries = [value] if isinstance(value, str | dict) else value
        return [{key: entry} if isinstance(entry, str) else entry for entry in entries]

    @field_validator("samplers", "effects", "metrics", mode="before")
    @classmethod
    def _names(cls, value):
        return [value] if isinstance(value, str) else value

    @field_validator("metrics")
    @classmethod
    def _known(cls, metrics):
        for name in metrics:
            if name not in METRICS:
                raise ValueError(f"no metric is called {name!r}{nearest(name, METRICS)}")
        return metrics

    @model_validator(mode="after")
    def _distinct(self):
        for field in ("spp", "samplers", "effects", "metrics"):
            _unique(field, getattr(self, field))
        for field in ("scenes", "integrators"):
            _unique(field, [entry.label for entry in getattr(self, field)])
        if self.timed is not None and self.timed > self.replicates:
            raise ValueError(f"timed is {self.timed}, more than the {self.replicates} replicates")
        return self

    def to_dict(self):
        """Return a dict that JSON can hold, from which `read` makes an equal one."""
        return self.model_dump(mode="json")


def read(spec, size="small"):
    """Return the `Specification` that ``spec`` stands for, in a size.

    Args:
        spec: a path of a TOML file, the name of a shipped study, a dict, or a `Specification`.
        size: ``small`` or ``paper``.

    Raises:
        UsageError: there is no such study, or something in it is wrong; one line with the field and the value.
    """
    if isinstance(spec, Specification):
        return spec
    if size not in SIZES:
        raise UsageError(f"size is {size!r}; accepted are {' and '.join(SIZES)}")
    if isinstance(spec, dict):
        return _validated(_sized(spec, size, "study"), "study")
    path = _locate(spec)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"cannot read {path}: {(error.strerror or str(error)).lower()}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: {error}") from error
    found = _validated(_sized(data, size, path), path)
    scenes = [_beside(entry, path.parent) for entry in found.scenes]
    return found.model_copy(update={"scenes": tuple(scenes)})


def shipped():
    """Return a dict from the name of each shipped study to its path."""
    return {path.stem: path for path in sorted((Path(__file__).parent / "shipped").glob("*" + SUFFIX))}


def _locate(spec):
    path = Path(spec)
    if path.is_dir():
        raise UsageError(f"{path}: a folder; the TOML file of a study is needed")
    if path.exists():
        return path
    text = str(spec)
    if os.sep in text or text.endswith(SUFFIX):
        raise UsageError(f"{path}: no such file")
    studies = shipped()
    if text not in studies:
        raise UsageError(f"no shipped study is called {text!r}{nearest(text, studies)}")
    return studies[text]


def _sized(data, size, where):
    """Return the dict with the table of ``size`` laid over it; tables within are laid over theirs."""
    data = dict(data)
    sizes = {name: data.pop(name, {}) for name in SIZES}
    over = sizes[size]
    if not isinstance(over, dict):
        raise UsageError(f"{where}: {size}: a table is needed, not {over!r}")
    return data | {key: _laid_over(data.get(key), value) for key, value in over.items()}


def _laid_over(value, over):
    return value | over if isinstance(value, dict) and isinstance(over, dict) else over


def _validated(data, where):
    try:
        return Specification.model_validate(data)
    except ValidationError as error:
        raise UsageError(f"{where}: {_first(error)}") from error


def _first(error):
    """The first of a validation's errors as a clause."""
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        known = Specification.model_fields if len(first["loc"]) == 1 else {}
        return f"{place}: there is no such field" + (nearest(str(first["loc"][0]), known) if known else "")
    if first["type"] == "missing":
        return f"{place}: the field is missing"
    message = first["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    return (
        f"{place}: {message}, not {first['input']!r}" if place and first["type"] != "value_error" else message
    )


def _unique(field, values):
    twice = next((value for i, value in enumerate(values) if value in list(values)[:i]), None)
    if twice is not None:
        raise ValueError(f"{field}: {twice!r} is there twice")


def _beside(entry, folder):
    """The scene's entry with a path relative to the study's file made one relative to the working folder."""
    path = folder / entry.scene
    is_name = os.sep not in entry.scene and not entry.scene.endswith(".xml")
    return (
        entry if is_name and not path.is_file() else entry.model_copy(update={"scene": os.path.abspath(path)})
    )
