"""An exponential that the compiler can vectorise over wavelengths.

``math.exp`` inside a loop stays a scalar library call.  Here exp(x) = 2^n 2^f with n the nearest integer to x/ln 2 and
|f| <= 1/2: 2^f is a polynomial, and n is added to the exponent bits of the result.  Everything is arithmetic without a
branch, so that LLVM turns the loop over wavelengths into SIMD code.  Relative error below 3e-10 (tested); arguments
below -700 give 1e-304, which is zero for every purpose here.
"""

from __future__ import annotations

from skyscatter.kernels.jit import intrinsic, merged
from skyscatter.kernels.later import ir, types

LOG2_E = 1.4426950408889634
#: ln 2 in two parts, the first with trailing zero bits, so that n * LN2_HIGH is exact.
LN2_HIGH = 0.6931471803691238
LN2_LOW = 1.9082149292705877e-10
#: Adding 1.5 * 2^52 leaves round(x) in the lowest bits of the sum.
ROUND = 6755399441055744.0


@intrinsic
def _scale_by_power_of_two(typingctx, value, rounded):
    """``value * 2**n`` where `rounded` is ``n + ROUND``: n sits in its low bits and is moved to the exponent."""

    def codegen(context, builder, signature, args):
        int64 = ir.IntType(64)
        bits = builder.bitcast(args[0], int64)
        shift = builder.shl(builder.bitcast(args[1], int64), ir.Constant(int64, 52))
        return builder.bitcast(builder.add(bits, shift), ir.DoubleType())

    return types.float64(types.float64, types.float64), codegen


@merged
def fast_exp(x):
    """exp(x) for x <= 700, branch-free."""
    x = max(x, -700.0)
    rounded = x * LOG2_E + ROUND
    n = rounded - ROUND
    f = (x - n * LN2_HIGH) - n * LN2_LOW
    # Taylor series about 0 on |f| <= 0.347: the first omitted term is f^9 / 9! < 3e-10.
    p = 1.0 + f * (
        1.0 + f * (1 / 2 + f * (1 / 6 + f * (1 / 24 + f * (1 / 120 + f * (1 / 720 + f * (1 / 5040 + f / 40320))))))
    )
    return _scale_by_power_of_two(p, rounded)


@merged
def fast_expm1_over(x):
    """(e^x - 1) / x for 0 <= x <= 700, 1 at 0, branch-free; relative error below 1e-8."""
    series = 1.0 + x * (1 / 2 + x * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x / 720))))
    return series if x < 0.1 else (fast_exp(x) - 1.0) / max(x, 0.1)
