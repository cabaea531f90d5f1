"""Sums of rows of numbers in single precision, eight at a time.

The innermost loops of the solver over orders are short: so many wavelengths.  For each of them the compiler would first
ask whether the rows overlap, and then choose between code for vectors and code for numbers, which takes longer than the
sum.  These rows never overlap, and so what is here is written as vector code to begin with.  Every product is rounded
before it is added, so that all processors get the same bits.

Arrays are C-contiguous, whatever their dimensions; where a row begins is counted in numbers from their start.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

from skyscatter.kernels.jit import intrinsic
from skyscatter.kernels.later import cgutils, ir, types

#: Numbers in a vector.
WIDE = 8


def _vector() -> Any:
    """Type of so many numbers side by side."""
    return ir.VectorType(ir.FloatType(), WIDE)


def _begin(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Address of a row."""
    return builder.gep(context.make_array(kind)(context, builder, array).data, [index])


def _spread(builder: Any, number: Any) -> Any:
    """A vector of one number."""
    vector = builder.insert_element(ir.Constant(_vector(), ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), WIDE), [0] * WIDE)
    return builder.shuffle_vector(vector, ir.Constant(_vector(), ir.Undefined), mask)


def _loop(builder: Any, count: Any, out: Any, rows: Sequence[Any], value: Callable[..., Any], adds: bool) -> None:
    """Set `out`, or add to it, what `value` makes of the numbers of rows: vectors first, then those that are left."""
    wide = ir.Constant(count.type, WIDE)
    whole = builder.mul(builder.sdiv(count, wide), wide)

    def at(pointer: Any, index: Any, vector: bool) -> Any:
        place = builder.gep(pointer, [index])
        return builder.bitcast(place, _vector().as_pointer()) if vector else place

    def step(index: Any, vector: bool) -> None:
        found = value([builder.load(at(row, index, vector), align=4) for row in rows], vector)
        if adds:
            found = builder.fadd(builder.load(at(out, index, vector), align=4), found)
        builder.store(found, at(out, index, vector), align=4)

    zero = ir.Constant(count.type, 0)
    with cgutils.for_range_slice(builder, zero, whole, wide) as (index, _):
        step(index, True)
    with cgutils.for_range_slice(builder, whole, count, ir.Constant(count.type, 1)) as (index, _):
        step(index, False)


@intrinsic
def add_product(typingctx, out, to, one, at_one, two, at_two, count):
    """``out[to + i] += one[at_one + i] * two[at_two + i]`` for i below `count`."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = signature.args
        rows = [_begin(context, builder, kinds[k], args[k], args[k + 1]) for k in (0, 2, 4)]
        _loop(builder, args[6], rows[0], rows[1:], lambda v, _: builder.fmul(*v), True)
        return context.get_dummy_value()

    places = types.intp
    return types.void(out, places, one, places, two, places, places), codegen


def _scaled(adds: bool) -> Callable[..., Any]:
    """A row times a factor, which is set or added."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = signature.args
        there, here = (_begin(context, builder, kinds[k], args[k], args[k + 1]) for k in (0, 3))
        many = _spread(builder, args[2])
        _loop(builder, args[5], there, [here], lambda v, wide: builder.fmul(many if wide else args[2], v[0]), adds)
        return context.get_dummy_value()

    return codegen


@intrinsic
def set_scaled(typingctx, out, to, factor, row, at, count):
    """``out[to + i] = factor * row[at + i]`` for i below `count`."""
    return types.void(out, types.intp, types.float32, row, types.intp, types.intp), _scaled(False)


@intrinsic
def add_scaled(typingctx, out, to, factor, row, at, count):
    """``out[to + i] += factor * row[at + i]`` for i below `count`."""
    return types.void(out, types.intp, types.float32, row, types.intp, types.intp), _scaled(True)


def _four(adds: bool, made: Callable[..., Any] = lambda builder, total, numbers: total) -> Callable[..., Any]:
    """Weighted sums of four rows, or what is made of a sum and its four numbers, which are set or added."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = signature.args
        there, first = (_begin(context, builder, kinds[k], args[k], args[k + 1]) for k in (0, 6))
        rows = [first]
        for _ in range(3):
            rows.append(builder.gep(rows[-1], [args[8]]))
        weights = args[2:6]
        many = [_spread(builder, weight) for weight in weights]

        def value(numbers: Any, wide: bool) -> Any:
            terms = [builder.fmul(f, x) for f, x in zip(many if wide else weights, numbers, strict=True)]
            total = builder.fadd(builder.fadd(terms[0], terms[1]), builder.fadd(terms[2], terms[3]))
            return made(builder, total, numbers)

        _loop(builder, args[9], there, rows, value, adds)
        return context.get_dummy_value()

    return codegen


def _four_types(out: Any, row: Any) -> Any:
    number, place = types.float32, types.intp
    return types.void(out, place, number, number, number, number, row, place, place, place)


@intrinsic
def add_sum_of_four(typingctx, out, to, v_0, v_1, v_2, v_3, row, at, step, count):
    """``out[to + i] += sum_k v_k row[at + k step + i]``, k from 0 to 3, for i below `count`."""
    return _four_types(out, row), _four(True)


#: log2(e), and ln 2 in two parts, the first with trailing zero bits; adding 1.5 * 2^23 leaves round(x) in the low bits.
LOG2_E, LN2_HIGH, LN2_LOW, ROUND = 1.4426950408889634, 0.693359375, -2.12194440e-4, 12582912.0
#: Below this an exponential is as good as zero.
LEAST_POWER = -86.0
#: Bits of a single-precision number behind its exponent.
MANTISSA = 23


def _exponential(builder: Any, x: Any) -> Any:
    """exp(x) in single precision, of a number or a vector; see `fastexp` for how."""
    kind, whole = x.type, ir.IntType(32)
    vector = kind == _vector()

    def real(value: float) -> Any:
        return ir.Constant(kind, [value] * WIDE if vector else value)

    x = builder.select(builder.fcmp_ordered(">", x, real(LEAST_POWER)), x, real(LEAST_POWER))
    rounded = builder.fadd(builder.fmul(x, real(LOG2_E)), real(ROUND))
    n = builder.fsub(rounded, real(ROUND))
    f = builder.fsub(builder.fsub(x, builder.fmul(n, real(LN2_HIGH))), builder.fmul(n, real(LN2_LOW)))
    # Taylor's series on |f| <= 0.347: the first term left out is f^7 / 7! < 1.2e-7.  Pairs of terms do not wait.
    square = builder.fmul(f, f)

    def pair(low: float, high: float) -> Any:
        return builder.fadd(builder.fmul(f, real(high)), real(low))

    total = builder.fadd(builder.fmul(square, real(1 / 720)), pair(1 / 24, 1 / 120))
    total = builder.fadd(builder.fmul(total, square), pair(1 / 2, 1 / 6))
    total = builder.fadd(builder.fmul(total, square), pair(1.0, 1.0))
    bits = ir.VectorType(whole, WIDE) if vector else whole
    places = ir.Constant(bits, [MANTISSA] * WIDE if vector else MANTISSA)
    power = builder.shl(builder.bitcast(rounded, bits), places)
    return builder.bitcast(builder.add(builder.bitcast(total, bits), power), kind)


def _between(builder: Any, x: Any, bounds: Sequence[Any]) -> Any:
    """A number, or a vector, no less than the least of some others and no more than the greatest."""

    def less(a: Any, b: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", a, b), a, b)

    def more(a: Any, b: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", a, b), a, b)

    return more(less(x, reduce(more, bounds)), reduce(less, bounds))


@intrinsic
def set_exponentials(typingctx, out, to, v_0, v_1, v_2, v_3, row, at, step, count):
    """``out[to + i] = exp(sum_k v_k row[at + k step + i])``, k from 0 to 3, for i below `count`.

    Where the four weights go beyond the four numbers that they are given to, the nearest of these counts.  Relative
    error below 1e-6 for sums of some tens.
    """

    def value(builder: Any, total: Any, numbers: Any) -> Any:
        return _exponential(builder, _between(builder, total, numbers))

    return _four_types(out, row), _four(False, value)


def _kinds(builder: Any, count: Any) -> Sequence[Any]:
    """For `for_range_slice`: vectors first, then the numbers that are left, with their types."""
    zero, one, wide = (ir.Constant(count.type, value) for value in (0, 1, WIDE))
    whole = builder.mul(builder.sdiv(count, wide), wide)
    return (_vector(), (zero, whole, wide)), (ir.FloatType(), (whole, count, one))


def _sum_terms(builder: Any, count: Any, there: Sequence[Any], terms: Any, term: Callable[..., Any]) -> None:
    """Add to each row of `there` what `term` makes of so many terms at a place, the sums being kept in registers."""
    for kind, places in _kinds(builder, count):
        with cgutils.for_range_slice(builder, *places) as (index, _):
            rows = [builder.bitcast(builder.gep(row, [index]), kind.as_pointer()) for row in there]
            totals = [_kept(builder, builder.load(row, align=4)) for row in rows]
            with cgutils.for_range(builder, terms) as loop:
                for total, found in zip(totals, term(loop.index, index, kind), strict=True):
                    builder.store(builder.fadd(builder.load(total), found), total)
            for row, total in zip(rows, totals, strict=True):
                builder.store(builder.load(total), row, align=4)


def _kept(builder: Any, value: Any) -> Any:
    """A place, a register in the end, that holds a value."""
    place = cgutils.alloca_once(builder, value.type)
    builder.store(value, place)
    return place


def _factor(builder: Any, given: Any, index: Any, kind: Any) -> Any:
    """A number of a row, as often as a kind has room for."""
    factor = builder.load(builder.gep(given, [index]))
    return _spread(builder, factor) if kind == _vector() else factor


def _numbers(builder: Any, row: Any, index: Any, kind: Any) -> Any:
    """A vector of numbers, or one, of a row."""
    return builder.load(builder.bitcast(builder.gep(row, [index]), kind.as_pointer()), align=4)


@intrinsic
def add_rows(typingctx, out, to, factors, at_factors, terms, row, at, step, count):
    """``out[to + i] += sum_k factors[at_factors + k] row[at + k step + i]``, k below `terms`, for i below `count`."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = signature.args
        there, given, first = (_begin(context, builder, kinds[k], args[k], args[k + 1]) for k in (0, 2, 5))

        def term(k: Any, index: Any, kind: Any) -> Any:
            here = builder.add(builder.mul(k, args[7]), index)
            return [builder.fmul(_factor(builder, given, k, kind), _numbers(builder, first, here, kind))]

        _sum_terms(builder, args[8], [there], args[4], term)
        return context.get_dummy_value()

    place = types.intp
    return types.void(out, place, factors, place, place, row, place, place, place), codegen


def _add_products(context: Any, builder: Any, kinds: Any, args: Any, there: Sequence[Any], right: Sequence[Any]) -> Any:
    """Sums of products for some rows: each factor is read once for all of them, and no sum waits for another.

    Of `kinds` and `args` are meant the list of numbers, where it begins, how many terms, the factors, and, at the end,
    the count.
    """
    listed = _begin(context, builder, kinds[0], args[0], args[1])
    left, count = context.make_array(kinds[3])(context, builder, args[3]).data, args[-1]

    def term(k: Any, index: Any, kind: Any) -> Any:
        here = builder.add(builder.mul(builder.load(builder.gep(listed, [k])), count), index)
        factor = _numbers(builder, left, here, kind)
        return [builder.fmul(factor, _numbers(builder, row, here, kind)) for row in right]

    _sum_terms(builder, count, there, args[2], term)
    return context.get_dummy_value()


@intrinsic
def add_products(typingctx, out, to, numbers, first, terms, one, two, at_two, count):
    """``out[to + i] += sum_k one[k count + i] two[at_two + k count + i]`` for i below `count`.

    The sum is over so many terms k of the list `numbers`, beginning with the one at `first`.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = signature.args
        there, right = (_begin(context, builder, kinds[k], args[k], args[k + 1]) for k in (0, 6))
        return _add_products(context, builder, kinds[2:], args[2:], [there], [right])

    place = types.intp
    return types.void(out, place, numbers, place, place, one, two, place, place), codegen


@intrinsic
def add_products_to_four(typingctx, out, to, to_step, numbers, first, terms, one, two, at_two, two_step, count):
    """The same for four rows at once, each a step further on in `out` and in `two`."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = signature.args
        there, right = ([_begin(context, builder, kinds[k], args[k], args[k + 1])] for k in (0, 7))
        for _ in range(3):
            there.append(builder.gep(there[-1], [args[2]]))
            right.append(builder.gep(right[-1], [args[9]]))
        return _add_products(context, builder, kinds[3:], args[3:], there, right)

    place = types.intp
    return types.void(out, place, place, numbers, place, place, one, two, place, place, place), codegen


@intrinsic
def add_turns_of_four(
    typingctx, out, to, v_0, v_1, v_2, v_3, row, at, step, part, factors, at_factors, factor_step, terms, count
):
    """A weighted sum of four rows of Fourier parts, added up at an azimuth.

    ``out[to + i] += sum_m factors[at_factors + m factor_step] sum_k v_k row[at + k step + m part + i]``, m below
    `terms`, k from 0 to 3, for i below `count`.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = signature.args
        there, first, given = (_begin(context, builder, kinds[k], args[k], args[k + 1]) for k in (0, 6, 10))
        rows = [first]
        for _ in range(3):
            rows.append(builder.gep(rows[-1], [args[8]]))
        many = [_spread(builder, weight) for weight in args[2:6]]

        def term(m: Any, index: Any, kind: Any) -> Any:
            here = builder.add(builder.mul(m, args[9]), index)
            weights = many if kind == _vector() else args[2:6]
            found = [builder.fmul(f, _numbers(builder, r, here, kind)) for f, r in zip(weights, rows, strict=True)]
            total = builder.fadd(builder.fadd(found[0], found[1]), builder.fadd(found[2], found[3]))
            return [builder.fmul(_factor(builder, given, builder.mul(m, args[12]), kind), total)]

        _sum_terms(builder, args[14], [there], args[13], term)
        return context.get_dummy_value()

    number, place = types.float32, types.intp
    return types.void(
        out, place, number, number, number, number, row, place, place, place, factors, place, place, place, place
    ), codegen


@intrinsic
def set_turns(typingctx, out, azimuth, at_cosine, at_sine, count, room, orders):
    """Cosines and sines of multiples of azimuths, of whose own there are so many.

    ``out[(2 m) room + i] = cos(m phi_i)`` and ``out[(2 m + 1) room + i] = sin(m phi_i)`` for m below `orders`.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = signature.args
        zero = ir.Constant(args[4].type, 0)
        there = _begin(context, builder, kinds[0], args[0], zero)
        own = [_begin(context, builder, kinds[1], args[1], at) for at in args[2:4]]

        for kind, places in _kinds(builder, args[4]):
            one, none = (ir.Constant(kind, [x] * WIDE if kind == _vector() else x) for x in (1.0, 0.0))
            with cgutils.for_range_slice(builder, *places) as (index, _):
                cosine, sine = (_numbers(builder, row, index, kind) for row in own)
                c, s = _kept(builder, one), _kept(builder, none)
                with cgutils.for_range(builder, args[6]) as loop:
                    x, y = builder.load(c), builder.load(s)
                    here = builder.add(builder.mul(builder.add(loop.index, loop.index), args[5]), index)
                    for value, place in ((x, here), (y, builder.add(here, args[5]))):
                        builder.store(value, builder.bitcast(builder.gep(there, [place]), kind.as_pointer()), align=4)
                    builder.store(builder.fsub(builder.fmul(x, cosine), builder.fmul(y, sine)), c)
                    builder.store(builder.fadd(builder.fmul(y, cosine), builder.fmul(x, sine)), s)
        return context.get_dummy_value()

    place = types.intp
    return types.void(out, azimuth, place, place, place, place, place), codegen


@intrinsic
def clear(typingctx, out, to, count):
    """``out[to + i] = 0`` for i below `count`."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        there = _begin(context, builder, signature.args[0], args[0], args[1])
        none = ir.Constant(_vector(), [0.0] * WIDE), ir.Constant(ir.FloatType(), 0.0)
        _loop(builder, args[2], there, [], lambda _, wide: none[0] if wide else none[1], False)
        return context.get_dummy_value()

    return types.void(out, types.intp, types.intp), codegen
