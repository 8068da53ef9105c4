"""What a render gives: the picture with its error, and an account of what was done, in what time, and left out."""

import json
import platform
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import version
from pathlib import Path

import numpy as np

from whitted import files, image
from whitted.effects import as_json
from whitted.stats.moments import Moments, root_mean_square


@dataclass
class Truncation:
    """What was given up to ``max_depth`` and to the cutoff, over all samples.

    ``add`` takes, for each account, sums over blocks of lanes of the luminance lost (as estimated) and of the
    throughput dropped (exact). Blocks are independent, so their spread gives the error of the estimate; it includes
    the spread of what is estimated, and is thus an upper bound.
    """

    NAMES = ("lost_by_depth", "lost_by_cutoff", "dropped_by_depth", "dropped_by_cutoff")

    samples: int = 0
    blocks: int = 0
    sums: np.ndarray = field(default_factory=lambda: np.zeros(4))
    squares: np.ndarray = field(default_factory=lambda: np.zeros(4))

    def add(self, samples, *blocks):
        """Add a pass: its number of lanes, and one array of block sums for each of ``NAMES``."""
        blocks = np.asarray(blocks, np.float64)
        self.samples += samples
        self.blocks += blocks.shape[1]
        self.sums += blocks.sum(1)
        self.squares += np.square(blocks).sum(1)

    def to_dict(self):
        """Return ``by_depth`` and ``by_cutoff``: means per sample of throughput dropped and radiance lost."""
        samples, blocks = max(self.samples, 1), max(self.blocks, 1)
        spread = np.sqrt(np.maximum(self.squares - np.square(self.sums) / blocks, 0)) / samples
        mean = self.sums / samples
        return {
            account: {
                "throughput_dropped": float(mean[2 + i]),
                "radiance_lost": float(mean[i]),
                "radiance_lost_error": float(spread[i]),
            }
            for i, account in enumerate(("by_depth", "by_cutoff"))
        }


@dataclass
class Render:
    """A picture, its standard error, and what it cost.

    Attributes:
        moments: ``Moments`` by group; channels are radiance (3, or 1 in mono variants), and for our integrators
            radiance lost, and alpha if pixels may be empty.
        spp: samples per pixel taken.
        requested: samples per pixel that were asked for in all, or None.
        rays: number of rays by kind.
        seconds: ``load``, ``trace`` (building kernels in Python), ``compile``, ``execute`` (kernels), ``total``.
        kernel: ``operations`` of the largest kernel, and ``cache_hit``: nothing was compiled.
        truncation: ``Truncation``, or None where the integrator keeps no account.
        nonfinite: samples that weren't finite; they are left out.
        diagnosis: `whitted.diagnosis.Diagnosis` of these; None without any, and for Mitsuba's integrators.
        partial: it ended before it was done.
        window: the pixels held, ``Window`` within a film of ``size`` (width, height).
        plan: `whitted.effects.Plan`, what is simulated and why; None where the integrator doesn't tell.
        error_kind: ``replicates``, or ``segments (upper bound)``.
        shares: `whitted.noise.Shares`, or None where they weren't measured.
    """

    moments: Moments = field(repr=False)
    spp: int
    requested: int | None
    rays: dict
    seconds: dict
    kernel: dict
    truncation: Truncation | None
    nonfinite: int
    partial: bool
    scene: str
    scene_hash: str
    integrator: str
    variant: str
    window: object
    size: tuple
    seed: int
    replicates: int
    error_kind: str
    diagnosis: object = field(default=None, repr=False)
    plan: object = field(default=None, repr=False)
    shares: object = field(default=None, repr=False)

    @property
    def effects(self):
        """The names of the effects simulated, a list; empty where the integrator doesn't tell."""
        return self.plan.effects if self.plan else []

    @property
    def _colours(self):
        return 1 if "_mono" in self.variant else 3

    @cached_property
    def _mean(self):
        return self.moments.mean()

    @property
    def mean(self):
        """The picture: radiance, linear, ``float32`` [H, W, 3] ([H, W, 1] in mono variants)."""
        return self._mean[..., : self._colours]

    @cached_property
    def standard_error(self):
        """The standard error of ``mean``, of its shape, or None where there are fewer than two groups."""
        return self.moments.first(self._colours).standard_error()

    @property
    def versions(self):
        """The versions of what the picture depends on, a dict."""
        return versions()

    @property
    def lost(self):
        """The luminance given up in each pixel as estimated, [H, W], or None where no account is kept."""
        return self._mean[..., self._colours] if self._mean.shape[-1] > self._colours else None

    @property
    def alpha(self):
        """The share of each pixel that isn't empty, [H, W], or None where all are full or it isn't known."""
        return self._mean[..., self._colours + 1] if self._mean.shape[-1] > self._colours + 1 else None

    @cached_property
    def error(self):
        """``rmse_estimate``: of the picture, absolute; ``standard_error_mean``: of its mean; None if unknown."""
        stderr = self.standard_error
        if stderr is None:
            return {"rmse_estimate": None, "standard_error_mean": None, "kind": None}
        return {
            "rmse_estimate": root_mean_square(stderr),
            "standard_error_mean": self.moments.first(self._colours).image_mean()[1],
            "kind": self.error_kind,
        }

    def to_dict(self):
        """Return the facts as ``--stats`` writes them, without the picture."""
        return {
            "scene": self.scene,
            "scene_hash": self.scene_hash,
            "integrator": self.integrator,
            "variant": self.variant,
            "width": self.window.width,
            "height": self.window.height,
            "spp": self.spp,
            "seed": self.seed,
            "replicates": self.replicates,
            "partial": self.partial,
            "effects": self.effects,
            "plan": self.plan.to_dict()["effects"] if self.plan else None,
            "techniques": self.plan.techniques if self.plan else None,
            "rays": self.rays,
            "seconds": self.seconds,
            "kernel": self.kernel,
            "truncation": self.truncation.to_dict() if self.truncation else None,
            "nonfinite": self.nonfinite,
            "nonfinite_causes": self.diagnosis.to_dict() if self.diagnosis else None,
            "error": self.error,
            "shares": self.shares.to_dict() if self.shares else None,
            "versions": versions(),
        }

    def picture(self):
        """Return the ``image.Picture``: radiance, standard error, samples and radiance lost, and the header."""
        colours = self.mean
        if self.alpha is not None and self.alpha.min() < 1 and self._colours == 3:
            colours = np.concatenate([colours, self.alpha[..., None]], axis=-1)
        channels = image.layer_channels("", colours)
        if self.standard_error is not None:
            channels |= image.layer_channels("stderr", self.standard_error)
        channels["spp.Y"] = np.full(colours.shape[:2], self.spp, np.float32)
        if self.lost is not None:
            channels["lost.Y"] = self.lost
        if self.shares is not None:
            channels |= self.shares.channels()
        header = {
            "samplesPerPixel": self.spp,
            "renderTimeSeconds": self.seconds["execute"],
            "compileTimeSeconds": self.seconds["compile"],
            "seed": self.seed,
            "integrator": self.integrator,
            "variant": self.variant,
            "effects": ",".join(self.effects),
            "plan": as_json(self.plan) if self.plan else "",
            "directLight": (self.plan.direct_light or "") if self.plan else "",
            "closedForm": {None: "", True: "true", False: "false"}[self.plan and self.plan.closed_form],
            "sceneHash": self.scene_hash,
            "partial": int(self.partial),
            "errorKind": self.error["kind"],
            "noiseShares": json.dumps(self.shares.to_dict()) if self.shares else None,
            **{f"{name}Version": number for name, number in versions().items()},
        }
        return image.Picture(channels, header, (self.window.x, self.window.y), self.size)

    def write(self, path):
        """Write the picture as EXR, and beside it the moments with which it can be continued.

        Raises:
            UsageError: the files can't be written.
        """
        image.write_exr(path, self.picture())
        arrays = {
            "sums": self.moments.sums.astype(np.float32),
            "weights": self.moments.weights.astype(np.float32),
        }
        image.write_moments(moments_path(path), arrays, self._facts())

    def _facts(self):
        kept = ("spp", "requested", "partial", "scene", "scene_hash", "integrator", "variant", "size", "seed")
        facts = {name: getattr(self, name) for name in (*kept, "replicates", "error_kind")}
        window = self.window
        return facts | {"window": [window.x, window.y, window.width, window.height]}

    @classmethod
    def read(cls, path):
        """Return the ``Render`` of a picture that ``write`` has written, to continue it; what it cost isn't kept.

        Raises:
            UsageError: the moments beside the picture are missing or damaged.
        """
        from whitted.film import Window

        arrays, facts = image.read_moments(moments_path(path))
        facts["window"], facts["size"] = Window(*facts["window"]), tuple(facts["size"])
        moments = Moments(arrays["sums"].astype(np.float64), arrays["weights"].astype(np.float64))
        return cls(moments=moments, rays={}, seconds={}, kernel={}, truncation=None, nonfinite=0, **facts)

    def _repr_html_(self):
        """Show the picture and a line of facts in a notebook."""
        from whitted import tonemap

        error = self.error["rmse_estimate"]
        facts = f"{self.scene}, {self.integrator}, {self.spp} spp, {self.seconds['execute']:.2f} s in kernels"
        facts += "" if error is None else f", standard error {error:.2g} (root mean square)"
        return f"{tonemap.html_image(self.picture().rgb)}<br>{facts}"


def moments_path(path):
    """Return the path of the moments kept beside the picture at ``path``."""
    return Path(path).with_suffix(".moments.npz")


def versions():
    """Return the versions of what a picture depends on."""
    import drjit as dr

    names = ("whitted", "mitsuba", "drjit", "numpy")
    llvm = ".".join(map(str, dr.detail.llvm_version()))
    return {name: version(name) for name in names} | {"python": platform.python_version(), "llvm": llvm}


def write_stats(path, stats):
    """Write a dict as JSON, whole or not at all."""
    files.write(path, (json.dumps(stats, indent=2) + "\n").encode())
