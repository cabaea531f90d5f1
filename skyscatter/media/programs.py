"""Terms of fields, and what operations make of them: the arithmetic of the kernels' small programs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from skyscatter.kernels.codes.space import (
    BOX,
    CARVE,
    CLOSED_FORM,
    CONE,
    GATE,
    GAUSSIAN_SPHERE,
    PIECES,
    POWER,
    POWER_LAW,
    PRODUCT,
    QUADRATURE,
    SCALE,
    SHELL,
    SPHERE,
    SUM,
    UNWARP,
    WARP,
)
from skyscatter.media.space import Array, FieldTerm, Instruction

_CLOSED = (SPHERE, GAUSSIAN_SPHERE, POWER_LAW, SHELL, BOX)


def is_indicator(step: Instruction) -> bool:
    """Whether a leaf is 1 within a shape and 0 outside."""
    return step.operation in (SPHERE, SHELL, BOX) or (step.operation == CONE and step.parameters[2] == 0.0)


def method_of(program: Sequence[Instruction]) -> int:
    """How the column of a program of analytic shapes is found."""
    if len(program) == 1 and program[0].operation in _CLOSED:
        return CLOSED_FORM
    if all(is_indicator(step) or (step.operation >= PRODUCT and step.operation != WARP) for step in program):
        return PIECES
    return QUADRATURE


def depths(program: Sequence[Instruction]) -> tuple[int, int]:
    """Most values and most warps that a program keeps at one time."""
    values, warps, most, most_warps = 0, 0, 0, 0
    for step in program:
        if step.operation < PRODUCT:
            values += 1
        elif step.operation in (PRODUCT, SUM, CARVE):
            values -= 1
        elif step.operation in (WARP, UNWARP):
            warps += 1 if step.operation == WARP else -1
        most, most_warps = max(most, values), max(most_warps, warps)
    return most, most_warps


def map_box(box: Array, matrix: Array, offset: Array) -> Array:
    """The box (2, 3) along the axes that holds the image of a box under x -> matrix x + offset."""
    middle = matrix @ (0.5 * (box[0] + box[1])) + offset
    half = np.abs(matrix) @ (0.5 * (box[1] - box[0]))
    return np.array([middle - half, middle + half])


def map_boxes(low: Array, high: Array, matrix: Array, offset: Array) -> tuple[Array, Array]:
    """`map_box` for many boxes (box, 3), wider by more than the rounding of any point's map: bounds stay bounds."""
    middle = 0.5 * (low + high) @ matrix.T + offset
    size = np.abs(matrix).T
    rounding = 1e-14 * (np.maximum(np.abs(low), np.abs(high)) @ size + np.abs(offset))
    half = 0.5 * (high - low) @ size * (1 + 1e-12) + rounding
    return middle - half, middle + half


def map_term(term: FieldTerm, matrix: Array, offset: Array) -> FieldTerm:
    """The term whose density at matrix x + offset is that of `term` at x."""
    inverse = np.linalg.inv(matrix)
    program, depth = [], 0
    for step in term.program:
        if depth == 0 and step.affine is not None:
            turned = step.affine[:, :3] @ inverse
            step = step._replace(affine=np.column_stack([turned, step.affine[:, 3] - turned @ offset]))
        # What is inside a warp counts from the warp's own frame.
        depth += {WARP: 1, UNWARP: -1}.get(step.operation, 0)
        program.append(step)
    shrink = float(np.linalg.svd(matrix, compute_uv=False).min())
    return term._replace(program=tuple(program), box=map_box(term.box, matrix, offset), scale=term.scale * shrink)


def multiply_terms(a: FieldTerm, b: FieldTerm) -> FieldTerm | None:
    """Product of two terms; None where they do not overlap."""
    box = np.array([np.maximum(a.box[0], b.box[0]), np.minimum(a.box[1], b.box[1])])
    if not (box[0] < box[1]).all():
        return None
    gate = Instruction(GATE, index=(len(b.program) + 1,))
    program = (*a.program, gate, *b.program, Instruction(PRODUCT))
    return FieldTerm(program, method_of(program), a.factor * b.factor, box, min(a.scale, b.scale))


def one_program(terms: Sequence[FieldTerm]) -> tuple[Instruction, ...]:
    """One program for the sum of terms, factors included."""
    parts = [t.program if t.factor == 1.0 else (*t.program, Instruction(SCALE, parameters=(t.factor,))) for t in terms]
    return reduce(lambda a, b: (*a, *b, Instruction(SUM)), parts)


def carve_term(a: FieldTerm, carver: Sequence[FieldTerm], level: float | None) -> FieldTerm:
    """A term where the carver is below a level, or times what the carver lacks to 1."""
    body = one_program(carver)
    step = Instruction(CARVE, parameters=(-1.0 if level is None else level,))
    program = (*a.program, Instruction(GATE, index=(len(body) + 1,)), *body, step)
    scale = min(a.scale, *(term.scale for term in carver))
    return FieldTerm(program, method_of(program), a.factor, a.box, scale)


def raise_terms(terms: Sequence[FieldTerm], exponent: float) -> tuple[FieldTerm, ...]:
    """Power of the sum of terms; closed forms stay closed where the power of a shape is such a shape again."""
    if len(terms) == 1:
        term = terms[0]
        step = raised_leaf(term.program[0], exponent) if len(term.program) == 1 else None
        program = (*term.program, Instruction(POWER, parameters=(exponent,))) if step is None else (step,)
        return (term._replace(program=program, method=method_of(program), factor=term.factor**exponent),)
    program = (*one_program(terms), Instruction(POWER, parameters=(exponent,)))
    boxes = np.array([term.box for term in terms])
    box = np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    return (FieldTerm(program, method_of(program), 1.0, box, min(term.scale for term in terms)),)


def raised_leaf(step: Instruction, exponent: float) -> Instruction | None:
    """The leaf that is the power of a leaf, if there is one."""
    p = step.parameters
    if is_indicator(step):
        return step
    if step.operation == GAUSSIAN_SPHERE and step.affine is not None:
        # Narrower by the root of the exponent, and cut at the same place.
        return step._replace(affine=step.affine * exponent**0.5, parameters=(p[0] * exponent,))
    if step.operation == POWER_LAW:
        return step._replace(parameters=(p[0] * exponent, p[1]))
    return None


def warp_term(term: FieldTerm, warp: Instruction, reach: float, scale: float) -> FieldTerm:
    """A term whose coordinates are displaced by at most `reach` [m] along each axis."""
    affine = warp.affine
    if affine is None:
        raise ValueError("a warp has a frame")
    into = affine[:, :3]
    inner = map_term(term, into, affine[:, 3])
    program = (warp, *inner.program, Instruction(UNWARP))
    box = term.box + reach * np.array([[-1.0], [1.0]])
    return FieldTerm(program, QUADRATURE, term.factor, box, min(term.scale, scale))
