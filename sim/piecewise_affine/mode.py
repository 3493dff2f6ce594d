"""From a combination of branches to x' = M x: eliminate accelerations and torques, also redundant and massless ones."""

import numpy as np
from numpy.typing import NDArray

from sim.piecewise_affine.kernel import CANCELLED
from sim.piecewise_affine.system import ZERO, Array, Basis, Constraints, Mode, System, bend, no_inertia

UNMOVED = 1e-6
"""What is left of a row that entering makes zero, relative to its terms: rounding over the lightest inertia."""


def compile_mode(system: System, key: tuple[int, ...]) -> Mode:
    """Return the mode in which component i is in its branch key[i].

    Three things make the plain system singular, and all are dealt with here. Shafts without inertia: the balance of
    torques on them binds angles and speeds; it is differentiated until accelerations appear, and entering the mode
    moves only what has no inertia. Torques that are not unique, as of two brakes that hold one shaft: the mode holds
    as long as any share of the torques keeps all limits (Fourier-Motzkin elimination of what is free to choose).
    Prescribed motion: no torque changes it, so what a mode asks of it (a stuck friction: speed, acceleration and all
    higher derivatives zero) either is so, or the mode cannot be.

    Raises
    ------
    RunError
        naming the flange that nothing holds.
    """
    known = system.known
    pieces = [system.pieces[i][branch] for i, branch in enumerate(key)]
    rows = equations(system, key)
    bound = system.state_rows(np.vstack([piece.stops for piece in pieces]))
    solve, free, hidden = _solve_unknowns(system, rows, np.vstack([piece.losses for piece in pieces]))
    enter = _entry(system, np.vstack([bound, hidden]))
    asked = _left_over(hidden, enter)
    moving = slice(0, 2 * system.freedom)
    if len(asked):  # they are zero to rounding where the mode is entered; exactly so, nothing moves by that rounding
        resting = np.vstack([bound, asked])
        resting /= np.abs(resting).max(axis=1, keepdims=True)
        enter[moving] -= np.linalg.pinv(resting[:, moving], rcond=ZERO) @ resting @ enter
        solve = _sum(solve, -solve @ np.linalg.pinv(resting, rcond=ZERO), resting, ZERO)
    limits = np.vstack([piece.holds for piece in pieces])
    owners = [frozenset([i]) for i, piece in enumerate(pieces) for _ in piece.holds]
    strict = np.concatenate([piece.strict for piece in pieces])
    by_state = _sum(system.state_rows(limits), limits[:, known:], solve)
    return Mode(
        key=key,
        matrix=_flow(system, solve),
        holds=_eliminate(by_state, limits[:, known:] @ free, strict, owners),
        stops=np.vstack([bound, asked]),
        enter=enter,
        solve=solve,
        rows=rows,
    )


def equations(system: System, key: tuple[int, ...]) -> Array:
    """All equations of a mode, rows over (y, z): balances of the nodes, kinematics, laws of the branches."""
    balances = np.zeros((system.node_count, system.width))
    laws = [balances, _shifted(system, system.kinematics)]
    for i, branch in enumerate(key):
        piece = system.pieces[i][branch]
        for node, torque in zip(piece.nodes, piece.torques, strict=True):
            balances[node] += torque
        laws.append(piece.equations)
    return np.vstack(laws)


def _shifted(system: System, rows: Array) -> Array:
    """Rows of angles as rows of the accelerations."""
    out = np.zeros_like(rows)
    out[:, system.known : system.known + system.node_count] = rows[:, : system.node_count]
    return out


def _derivative(system: System, rows: Array) -> Array:
    """Time derivative of rows over y, as rows over (y, z)."""
    n, known = system.node_count, system.known
    out = np.zeros_like(rows)
    out[:, n : 2 * n] = rows[:, :n]
    out[:, known : known + n] = rows[:, n : 2 * n]
    for signal, (_, swing) in zip(system.signals, system.signal_columns, strict=True):
        out[:, swing + 1] += rows[:, swing]
        by_swing, by_rate = bend(signal)
        out[:, swing] += by_swing * rows[:, swing + 1]
        out[:, swing + 1] += by_rate * rows[:, swing + 1]
    return out


def _solve_unknowns(system: System, rows: Array, losses: Array) -> tuple[Array, Array, Array]:
    """Return z = solve x, the directions of z that are free to choose, and rows of x that must be zero at all times.

    Where equations bind the state alone, their derivatives take their place, and those bind in turn, until nothing new
    comes. Of torques that nothing determines, those of friction (`losses`, rows over (y, z)) are the least possible.
    """
    known = system.known
    hidden = np.zeros((0, system.state_width))
    taken = Basis(system.state_width)
    while True:
        scale = np.abs(rows[:, known:]).max(axis=1)
        usable = scale > 0
        rows = np.vstack([rows[usable] / scale[usable, None], rows[~usable]])
        unknown = rows[:, known:]
        columns = np.maximum(np.abs(unknown).max(axis=0), 1e-300)
        inverse = _inverse(unknown / columns)
        if inverse is not None:
            free = np.zeros((unknown.shape[1], 0))
            break
        left, size, right = np.linalg.svd(unknown / columns)
        rank = int(np.count_nonzero(size > ZERO * size[0])) if len(size) else 0
        lost = left[:, rank:].T @ rows
        rounding = ZERO * (np.abs(left[:, rank:].T) @ np.abs(rows)) + CANCELLED * np.abs(rows).max(axis=0)
        lost[np.abs(lost) <= rounding] = 0.0
        lost[:, known:] = 0.0
        bound = _sum(np.zeros((len(lost), system.state_width)), lost[:, :known], system.to_known, ZERO)
        real = np.abs(bound).max(axis=1) > ZERO * np.maximum(1.0, np.abs(rows[:, :known]).max())
        new = [i for i in np.flatnonzero(real) if taken.take(bound[i])]
        if not new:
            inverse = (right[:rank].T / size[:rank]) @ left[:, :rank].T
            free = right[rank:].T
            break
        hidden = np.vstack([hidden, bound[new]])
        unit = lost[new] / np.abs(lost[new]).max(axis=1, keepdims=True)
        rows = np.vstack([left[:, :rank].T @ rows, _derivative(system, unit)])
    inverse[np.abs(inverse) <= CANCELLED * np.abs(inverse).max(initial=0.0)] = 0.0
    inverse /= columns[:, None]
    free[np.abs(free) <= CANCELLED] = 0.0
    free = free / columns[:, None]
    moving = np.abs(free[: system.node_count])
    if moving.size and moving.max() > 1e-6 * np.abs(free).max():
        raise no_inertia(system, moving.max(axis=1))
    right_side = -system.state_rows(rows)
    solve = _sum(np.zeros_like(inverse @ right_side), inverse, right_side)
    if free.shape[1]:
        share = losses[:, known:] @ free
        torques = system.state_rows(losses) + losses[:, known:] @ solve
        solve = _sum(solve, -free @ np.linalg.pinv(share, rcond=ZERO), torques)
    return solve, free, hidden


def _inverse(matrix: Array) -> Array | None:
    """The inverse of a square matrix whose singular values are all above `ZERO` of the largest, else None."""
    if matrix.shape[0] != matrix.shape[1]:
        return None
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return None
    return np.asarray(inverse) if np.linalg.norm(matrix) * np.linalg.norm(inverse) < 1 / ZERO else None


def _sum(start: Array, left: Array, right: Array, rounding: float = CANCELLED) -> Array:
    """Return start + left @ right, in which terms that cancel to rounding are exactly zero."""
    total = start + left @ right
    total[np.abs(total) <= rounding * (np.abs(start) + np.abs(left) @ np.abs(right))] = 0.0
    return np.asarray(total)


def _flow(system: System, solve: Array) -> Array:
    """x' = M x: coordinates move with their speeds, speeds with the solved accelerations, signals by themselves."""
    count = system.freedom
    matrix = system.signal_flow()
    matrix[:count, count : 2 * count] = np.eye(count)
    matrix[count : 2 * count] = _sum(np.zeros((count, len(matrix))), system.coordinates, solve[: system.node_count])
    return matrix


def _entry(system: System, rows: Array) -> Array:
    """Return the map of x on entering: rows become zero by the least change, measured in kinetic energy.

    Prescribed motions do not change: there the change is measured with an infinite inertia.
    """
    width, count = system.state_width, system.freedom
    enter = np.eye(width)
    if not len(rows):
        return enter
    ways, light = system.unprescribed, system.light
    for part in (slice(count, 2 * count), slice(0, count)):
        least = ZERO * np.abs(rows).max(axis=1)
        fast = np.abs(rows[:, count : 2 * count]).max(axis=1, initial=0) > least
        chosen = rows[fast] if part.start else rows[~fast]
        along = chosen[:, part] @ ways
        can = np.abs(along).max(axis=1, initial=0) > (least[fast] if part.start else least[~fast])
        if not can.any():
            continue
        chosen, along = chosen[can], along[can]
        moves = np.linalg.solve(light, along.T)
        step = ways @ moves @ np.linalg.pinv(along @ moves, rcond=1e-9)
        change = np.eye(width)
        change[part] = _sum(change[part], -step, chosen)
        enter = enter @ change if part.start == 0 else change @ enter
    return enter


def _left_over(hidden: Array, enter: Array) -> Array:
    """Rows that must be zero and that entering does not make so: they speak of what is prescribed."""
    left = hidden @ enter
    size = np.abs(hidden) @ np.abs(enter)
    left[np.abs(left) <= UNMOVED * size] = 0.0
    return np.asarray(left[np.abs(left).max(axis=1, initial=0) > 0])


def _eliminate(rows: Array, free: Array, strict: NDArray[np.bool_], owners: list[frozenset[int]]) -> Constraints:
    """Drop what is free to choose from rows . x + free . choice >= 0, and rows that always hold.

    Fourier-Motzkin elimination; a row made of more than k + 1 of the first ones after k steps follows from others
    (Chernikov), as does a multiple of another row.
    """
    origins = [frozenset([i]) for i in range(len(rows))]
    for step in range(1, free.shape[1] + 1):
        size = np.abs(free).max(axis=0, initial=0.0)
        if not size.any():
            break
        column = int(np.argmax(size))
        share = free[:, column]
        plus, minus, rest = (np.flatnonzero(test) for test in _signs(share))
        pairs = [(i, j) for i in plus for j in minus if len(origins[i] | origins[j]) <= step + 1]
        mixed = np.array([[-share[j], share[i]] for i, j in pairs]).reshape(-1, 2)
        first, second = [i for i, _ in pairs], [j for _, j in pairs]
        rows = np.vstack([rows[rest], mixed[:, :1] * rows[first] + mixed[:, 1:] * rows[second]])
        free = np.vstack([free[rest], mixed[:, :1] * free[first] + mixed[:, 1:] * free[second]])
        free[:, column] = 0
        owners = [owners[i] for i in rest] + [owners[i] | owners[j] for i, j in pairs]
        origins = [origins[i] for i in rest] + [origins[i] | origins[j] for i, j in pairs]
        strict = np.array([*strict[rest], *([False] * len(pairs))], dtype=np.bool_)
        one = _distinct(np.hstack([rows, free]), strict)
        rows, free, strict = rows[one], free[one], strict[one]
        owners, origins = [owners[i] for i in one], [origins[i] for i in one]
    size = np.abs(rows[:, :-1]).max(axis=1, initial=0)
    kept = (size > 1e-13 * np.maximum(1.0, np.abs(rows[:, -1]))) | (rows[:, -1] < 0) | strict
    rows = np.where(np.abs(rows) < 1e-15 * np.abs(rows).max(axis=1, initial=1e-300, keepdims=True), 0.0, rows)
    return Constraints(rows[kept], strict[kept], tuple(owner for owner, keep in zip(owners, kept, strict=True) if keep))


def _distinct(rows: Array, strict: NDArray[np.bool_]) -> list[int]:
    """Numbers of rows that are no multiple of an earlier one; strict ones all stay."""
    scale = np.maximum(np.abs(rows).max(axis=1, initial=0.0, keepdims=True), 1e-300)
    rounded = np.round(rows / scale, 11) + 0.0
    seen: set[bytes] = set()
    out = []
    for i, row in enumerate(rounded):
        key = row.tobytes()
        if strict[i] or key not in seen:
            out.append(i)
        seen.add(key)
    return out


def _signs(share: Array) -> tuple[Array, Array, Array]:
    small = ZERO * np.abs(share).max()
    return share > small, share < -small, np.abs(share) <= small
