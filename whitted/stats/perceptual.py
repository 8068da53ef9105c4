r"""Differences between two pictures as people see them: FLIP and CIEDE2000. For looking at pictures, not for proofs.

FLIP is that of its authors' package, for pictures of low [AnderssonEtAl2020] and high dynamic range
[AnderssonEtAl2021]; CIEDE2000 [SharmaWuDalal2005] is colour-science's. Both packages are imported where they are used,
since that takes a second. Left out: noise of the reference, which raises both.
"""

import warnings

import numpy as np

PPD = 67.0  # pixels per degree: a 0.7 m wide screen of 3840 pixels seen from 0.7 m, FLIP's own default
BRIGHTEST = 65504.0  # radiance beyond counts as this, so that FLIP's exposures stay few
DARKEST = 2.0**-20  # luminance below counts as black: FLIP ends the process where it can't expose a reference
WHITE = 2.1187  # luminance that FLIP's tone mapping, ACES, takes to 0.85
LUMINANCE = (0.2126, 0.7152, 0.0722)  # of Rec. 709


def flip(image, reference, ppd=PPD, hdr=None):
    """Return the mean FLIP error and its map.

    0 is no difference, 1 the largest. HDR-FLIP takes the largest error over exposures from that which shows the
    reference's maximum to that which shows its median; here to the median of its lit pixels where half of them are
    black, and LDR-FLIP is taken where all are. Negative and infinite radiance count as 0 and 65504.

    Args:
        image, reference: [H, W, 3] or [H, W, 1], linear Rec. 709 radiance; or ``uint8`` sRGB, as
            `whitted.tonemap.tone_map` makes it.
        ppd: pixels per degree of visual angle, > 0.
        hdr: True for HDR-FLIP, False for LDR-FLIP, which clips radiance to [0, 1]; by default HDR-FLIP of radiance and
            LDR-FLIP of ``uint8``.

    Returns:
        ``float`` in [0, 1], and ``float32`` [H, W]; NaN where either picture is NaN, and then the mean is.

    Raises:
        ValueError: the pictures don't match, or ``ppd`` isn't positive.
    """
    is_srgb = _are_srgb(image, reference)
    if not ppd > 0:
        raise ValueError(f"ppd is {ppd}; it has to be positive")
    from flip_evaluator import evaluate

    image, reference = (np.asarray(x, np.float64) / (255 if is_srgb else 1) for x in (image, reference))
    absent = (np.isnan(image) | np.isnan(reference)).any(axis=-1)
    image, reference = (_three_channels(x, absent) for x in (image, reference))
    hdr = not is_srgb if hdr is None else hdr
    exposures = _exposures(reference) if hdr else None
    errors, _, _ = evaluate(
        reference,
        image,
        "LDR" if exposures is None else "HDR",
        inputsRGB=is_srgb,
        applyMagma=False,
        computeMeanError=False,
        parameters={"ppd": float(ppd), **(exposures or {})},
    )
    errors = np.where(absent, np.float32(np.nan), errors[..., 0])
    return float(errors.mean(dtype=np.float64)), errors


def ciede2000(image, reference, exposure=0.0):
    r"""Return the mean colour difference :math:`\Delta E_{00}` and its map.

    Radiance is exposed, clipped to [0, 1] as a screen clips it, and taken to CIE Lab with D65 as white. About 1 is
    just noticeable between even fields side by side; black and white differ by 100.

    Args:
        image, reference: [H, W, 3] or [H, W, 1], linear Rec. 709 radiance.
        exposure: in stops: +1 doubles the radiance.

    Returns:
        ``float`` >= 0, and ``float64`` [H, W]; NaN where either picture is NaN, and then the mean is.

    Raises:
        ValueError: the pictures don't match, or aren't linear.
    """
    if _are_srgb(image, reference):
        raise ValueError("the pictures are uint8; linear radiance is needed")
    colour = _colour()
    space = colour.RGB_COLOURSPACES["sRGB"]

    def lab(picture):
        linear = np.clip(np.asarray(picture, np.float64) * 2.0**exposure, 0.0, 1.0)
        linear = np.broadcast_to(linear, (*linear.shape[:2], 3))
        return colour.XYZ_to_Lab(linear @ space.matrix_RGB_to_XYZ.T, space.whitepoint)

    difference = colour.delta_E(lab(image), lab(reference), method="CIE 2000")
    return float(difference.mean()), difference


def _are_srgb(image, reference):
    """Return whether two pictures, which have to match, are ``uint8``."""
    image, reference = np.asarray(image), np.asarray(reference)
    if image.shape != reference.shape or image.ndim != 3 or image.shape[-1] not in (1, 3):
        raise ValueError(
            f"pictures are [H, W, 3] or [H, W, 1] of one size, not {image.shape} and {reference.shape}"
        )
    kinds = {x.dtype == np.uint8 for x in (image, reference)}
    if len(kinds) > 1:
        raise ValueError(f"one picture is uint8, the other isn't: {image.dtype} and {reference.dtype}")
    return kinds.pop()


def _three_channels(picture, absent):
    """Return what FLIP can take, black where ``absent``; of fewer channels it would read past the end."""
    clipped = np.where(absent[..., None], 0.0, np.clip(picture, 0.0, BRIGHTEST))
    return np.ascontiguousarray(np.broadcast_to(clipped, (*clipped.shape[:2], 3)), np.float32)


def _exposures(reference):
    """Return what FLIP is to be told about exposures, a dict; None where the reference is black."""
    luminance = reference @ np.float32(LUMINANCE)
    lit = luminance[luminance > DARKEST]
    if 2 * lit.size > luminance.size:
        return {}
    # left alone it tries all exposures up to 2^24; the margin keeps rounding from making the range empty
    return {"stopExposure": float(np.log2(WHITE / np.median(lit))) + 1e-3} if lit.size else None


def _colour():
    """Import colour-science without its remarks on the packages that it could also use."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    return colour
