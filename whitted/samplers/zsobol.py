"""Owen-scrambled Sobol' points spread over the screen along a shuffled Z-curve, as a Mitsuba sampler.

Source: [AhmedWonka2020]. Left out: the shuffle of the curve for each pair of dimensions; here one point serves the
first dimensions, and the others shuffle its place in the sequence.
"""

import drjit as dr
import mitsuba as mi

from whitted.sampling.sampler import divided, sampler_type, whole_number
from whitted.sampling.screen import morton, shuffle_digits
from whitted.sampling.sequences import hash4

MAX_SIDE = 1 << 16
MAX_BORDER = 16  # pixels that a film with sample_border may add on each side


class ZSobolSampler(sampler_type(mi.variant())):
    """Sobol' points, one sequence for the whole screen, so that the error is blue noise (``zsobol``).

    ================ ======= ======================================================================== =======
    parameter        type    meaning                                                                  default
    ================ ======= ======================================================================== =======
    ``sample_count`` integer samples per pixel, 1 to 2^24; powers of two are the best distributed     4
    ``width``        integer pixels in a row of what is rendered: the film's crop, without borders    none
    ``height``       integer rows of it; both 1 to 65536                                              none
    ``seed``         integer of the randomisation, 0 to 2^32 - 1, beside the seed of each render      0
    ================ ======= ======================================================================== =======

    Pixels that are near each other have samples that are near in the sequence. Together these are well distributed
    too, and so the errors of neighbours are opposed: they vanish when the picture is seen from afar, filtered or
    denoised. The error of a single pixel is that of ``owen_sobol``.

    * Bias: none, with any sample count and any number of passes.
    * Where the square around the screen would have more than 2^32 samples, its parts repeat one pattern.

    .. code-block:: xml

        <sampler type="zsobol">
            <integer name="sample_count" value="4"/>
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
        </sampler>
    """

    def __init__(self, props):
        super().__init__(props)
        self.width = whole_number(props, "width", None, 1, MAX_SIDE)
        self.height = whole_number(props, "height", None, 1, MAX_SIDE)

    def parameters(self):
        """Return the parameters of the plugin as a ``dict``."""
        return {**super().parameters(), "width": self.width, "height": self.height}

    def place(self, lane):
        """Number the samples along the Z-curve; lanes are ordered by rows of pixels, then by sample."""
        columns, rows, self.stride = self._layout()
        low = (self.sample_count() - 1).bit_length()
        pixel = divided(lane, self.stride)
        number = self.taken + lane - pixel * dr.opaque(mi.UInt32, self.stride)
        y = divided(pixel, columns)
        x = pixel - y * dr.opaque(mi.UInt32, columns)
        bits = low + 2 * min((max(columns, rows) - 1).bit_length(), (32 - low) // 2)
        along = ((morton(x, y) << low) | (number & ((1 << low) - 1))) & ((1 << bits) - 1)
        *order, a, b = hash4(number >> low, mi.UInt32(0), *self.words)
        self.key = [a, b, order[1]]
        self.index = shuffle_digits(along, bits, order)
        self.bits = max(8, -(-bits // 8) * 8)

    def _layout(self):
        """Return columns and rows of pixels, and the samples of each in the wavefront.

        Raises:
            ValueError: the wavefront doesn't fit the screen.
        """
        lanes, count = self.wavefront_size(), self.sample_count()
        if lanes == 1:
            return 1, 1, 1  # Mitsuba resets samplers so, to free memory
        for border in range(MAX_BORDER + 1):  # nearly always 0
            columns, rows = self.width + 2 * border, self.height + 2 * border
            if lanes == columns * rows * (self.per_pass or count):
                return columns, rows, self.per_pass or count
        per_pass, rest = divmod(lanes, self.width * self.height)
        if rest or not per_pass or count % per_pass:
            raise ValueError(
                f"zsobol: {lanes} samples are rendered, but width {self.width}, height {self.height} and sample_count "
                f"{count} make {self.width * self.height * count}"
            )
        return self.width, self.height, per_pass


mi.register_sampler("zsobol", ZSobolSampler)
