"""Owen-scrambled Sobol' points as a Mitsuba sampler, each pixel with its own randomisation.

Source: as in ``whitted.sampling.sobol`` and ``whitted.sampling.sampler``. Left out: an order over the screen, for
which see ``zsobol``.
"""

import drjit as dr
import mitsuba as mi

from whitted.sampling.sampler import divided, sampler_type
from whitted.sampling.sequences import hash4


class OwenSobolSampler(sampler_type(mi.variant())):
    """Sobol' points, Owen-scrambled in each pixel by itself (``owen_sobol``).

    ================ ======= ======================================================================== =======
    parameter        type    meaning                                                                  default
    ================ ======= ======================================================================== =======
    ``sample_count`` integer samples per pixel, 1 to 2^24; powers of two are the best distributed     4
    ``seed``         integer of the randomisation, 0 to 2^32 - 1, beside the seed of each render      0
    ================ ======= ======================================================================== =======

    The first eight numbers of a sample are coordinates of one point: with ``path`` those are the position in the
    pixel and the draws at the first hit. All further ones come from (0, 2)-sequences, one for each draw, in an order
    shuffled anew. Any ``2**k`` samples of a pixel that begin at a multiple of ``2**k`` are stratified into as many
    intervals in each number, and into all elementary intervals of as small an area in the first two and in each
    later pair.

    * Bias: none, with any sample count and any number of passes.
    * Passes: a sampler never learns how many samples Mitsuba's own integrators take in one pass where
      ``samples_per_pass`` splits a render. Each pass is then randomised anew, and stratified only in itself.

    .. code-block:: xml

        <sampler type="owen_sobol">
            <integer name="sample_count" value="64"/>
        </sampler>
    """

    def place(self, lane):
        """Number the samples pixel by pixel, as Mitsuba orders them: by lane."""
        count = self.sample_count()
        per_pass = self.per_pass or count
        used = (count - 1).bit_length()
        self.bits = max(8, -(-used // 8) * 8)  # whole bytes, so that one kernel serves more counts
        self.stride = self.per_pass or 1 << self.bits
        pixel = divided(lane, per_pass)
        number = self.taken + lane - pixel * dr.opaque(mi.UInt32, per_pass)
        self.index = number & ((1 << self.bits) - 1)
        self.key = list(hash4(pixel, number >> self.bits, *self.words)[1:])


mi.register_sampler("owen_sobol", OwenSobolSampler)
