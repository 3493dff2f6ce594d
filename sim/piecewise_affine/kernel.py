"""Compiled inner loop of the exact engine: x' = M x from event to event, samples on an even grid.

Importing this module imports numba. All functions stay in this file because numba's cache does not see changes in
callees of other files.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"

from __future__ import annotations

import numpy as np
from numba import njit

DONE, ASK, STORM, LOG_FULL = 0, 1, 2, 3
ORDER = 16
"""Terms of the Taylor series; with steps of at most 0.7 over the largest eigenvalue the rest is below rounding."""
DERIVATIVES = 5
"""How many derivatives decide whether a branch holds at an instant where its inequality is just zero."""
CHUNK = 32
"""Samples per matrix product on the fast path."""
CANCELLED = 1e-13
"""What is left of terms that cancel, relative to them."""
TOLERANCE = 1e-11
"""A value below this, relative to the terms it is the sum of, is zero."""
INSTANT = 1e-15
"""What happens within this time [s] happens at once."""
STOP_TOLERANCE = 1e-9
STANDSTILL = 1e-15
"""A speed below this [rad/s] is zero, however small all speeds have been."""
NATURAL = 1e-4
"""Share of what the terms of its acceleration amount to within a time constant that a speed is taken to have had: times
`STOP_TOLERANCE`, the rounding of these terms, which no speed is free of."""
MAX_EVENTS = 2000
"""Events within one sample interval from which on it is called a storm."""

# positions in `state` (integers) and `clock` (floats)
SAMPLE, MODE, STOP, LOGGED, ROW, EVENTS, CHECK = range(7)

_jit = njit(cache=True, error_model="numpy", fastmath={"contract", "nsz"}, nogil=True)


@_jit
def holding(x, scale, derivatives, strict, rows):
    """First inequality that does not hold from now on (value, else first derivative that is not zero), or -1."""
    n = x.shape[0]
    for r in range(rows):
        size = 0.0
        for j in range(n):
            size += abs(derivatives[0, r, j]) * scale[j]
        for k in range(DERIVATIVES):
            value = 0.0
            growth = 0.0
            for j in range(n):
                value += derivatives[k, r, j] * x[j]
                if k + 1 < DERIVATIVES:
                    growth += abs(derivatives[k + 1, r, j]) * scale[j]
            least = TOLERANCE * size + INSTANT * growth
            if value > least:
                break
            if value < -least:
                return r
            if k + 1 == DERIVATIVES and strict[r]:
                return r
            size = growth
    return -1


@_jit
def resting(x, scale, stops, rows):
    """Whether all speeds that a mode wants to be zero are zero."""
    for r in range(rows):
        value = 0.0
        size = 0.0
        for j in range(x.shape[0]):
            value += stops[r, j] * x[j]
            size += abs(stops[r, j]) * scale[j]
        if abs(value) > STOP_TOLERANCE * size + STANDSTILL:
            return False
    return True


@_jit
def enlarge(x, scale, matrix, moving, rate):
    """Let `scale` hold how large each state has been at least, speeds also by what accelerates them at 1/rate."""
    n = x.shape[0]
    for j in range(n):
        scale[j] = max(scale[j], abs(x[j]))
    if rate > 0.0:
        for i in range(moving // 2, moving):
            total = 0.0
            for j in range(n):
                total += abs(matrix[i, j]) * scale[j]
            scale[i] = max(scale[i], NATURAL * total / rate)


@_jit
def _series(matrix, x, terms):
    """Taylor coefficients of x(t): terms[k] = matrix^k x / k!."""
    n = x.shape[0]
    for i in range(n):
        terms[0, i] = x[i]
    for k in range(1, ORDER + 1):
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += matrix[i, j] * terms[k - 1, j]
            terms[k, i] = total / k


@_jit
def _evaluate(terms, t, x):
    for i in range(x.shape[0]):
        total = terms[ORDER, i]
        for k in range(ORDER - 1, -1, -1):
            total = total * t + terms[k, i]
        x[i] = total


@_jit
def _value(c, t):
    total = c[ORDER]
    for k in range(ORDER - 1, -1, -1):
        total = total * t + c[k]
    return total


@_jit
def _slope(c, t):
    total = ORDER * c[ORDER]
    for k in range(ORDER - 1, 0, -1):
        total = total * t + k * c[k]
    return total


@_jit
def _bend(c, t):
    total = ORDER * (ORDER - 1) * c[ORDER]
    for k in range(ORDER - 1, 1, -1):
        total = total * t + k * (k - 1) * c[k]
    return total


@_jit
def _root(c, low, high):
    """Root of the polynomial between low (value >= 0) and high (value < 0): Newton kept within the bracket."""
    t = high
    f = _value(c, t)
    for _ in range(80):
        d = _slope(c, t)
        new = t - f / d if d != 0.0 else low
        if not (low < new < high):
            new = 0.5 * (low + high)
        if abs(new - t) <= 1e-17 + 2e-16 * abs(new):
            return new
        t = new
        f = _value(c, t)
        if f >= 0.0:
            low = t
        else:
            high = t
    return t


@_jit
def _bottom(c, low, high):
    """Where the slope is zero between low (falling) and high (rising)."""
    t = 0.5 * (low + high)
    for _ in range(60):
        d = _slope(c, t)
        if d < 0.0:
            low = t
        else:
            high = t
        b = _bend(c, t)
        new = t - d / b if b != 0.0 else low
        if not (low < new < high):
            new = 0.5 * (low + high)
        if abs(new - t) <= 1e-15 * abs(high):
            return new
        t = new
    return t


@_jit
def _zero(derivatives, r, scale):
    """What is as good as zero for an inequality: rounding, and its growth within an instant."""
    size = 0.0
    growth = 0.0
    for j in range(scale.shape[0]):
        size += abs(derivatives[0, r, j]) * scale[j]
        growth += abs(derivatives[1, r, j]) * scale[j]
    return CANCELLED * size + INSTANT * growth


@_jit
def _first_crossing(c, dt, zero):
    """First instant in [0, dt] from which on the polynomial is below -zero, or -1: also between two crossings."""
    parts = 8
    before = 0.0
    f = c[0]
    d = c[1]
    for p in range(1, parts + 1):
        t = dt * p / parts
        g = _value(c, t)
        e = _slope(c, t)
        if g < -zero:
            if f >= 0.0:
                return _root(c, before, t)
            if p == 1 and d <= 0.0:
                return 0.0
            if p == 1:
                top = before
                for q in range(1, 33):
                    u = t * q / 32
                    if _value(c, u) >= 0.0:
                        top = u
                if top > before:
                    return _root(c, top, t)
            return before
        if d < 0.0 and e > 0.0 and f >= 0.0:
            u = _bottom(c, before, t)
            if _value(c, u) < -zero:
                return _root(c, before, u)
        before = t
        f = g
        d = e
    return -1.0


@_jit
def _suspicious(r, x, y, scale, dt, derivatives):
    """Whether an inequality may break between x and y = x(dt): negative at the end, or near zero against its bend."""
    f = 0.0
    g = 0.0
    d = 0.0
    e = 0.0
    for j in range(x.shape[0]):
        f += derivatives[0, r, j] * x[j]
        g += derivatives[0, r, j] * y[j]
        d += derivatives[1, r, j] * x[j]
        e += derivatives[1, r, j] * y[j]
    if g < 0.0 and g < -_zero(derivatives, r, scale):
        return True
    return d < 0.0 and e > 0.0 and min(f, g) < 0.5 * dt * max(-d, e)


@_jit
def _any_suspicious(x, y, scale, dt, derivatives, rows):
    found = False
    for r in range(rows):
        found = found or _suspicious(r, x, y, scale, dt, derivatives)
    return found


@_jit
def _crossing(terms, x, y, derivatives, scale, rows, dt, c):
    """First inequality that breaks between x and y = x(dt), and when: (row, time), row -1 if none does."""
    n = terms.shape[1]
    first = -1
    when = dt
    for r in range(rows):
        if not _suspicious(r, x, y, scale, dt, derivatives):
            continue
        for k in range(ORDER + 1):
            total = 0.0
            for j in range(n):
                total += derivatives[0, r, j] * terms[k, j]
            c[k] = total
        t = _first_crossing(c, when, _zero(derivatives, r, scale))
        if t >= 0.0 and (t < when or first < 0):
            when = t
            first = r
    return first, when


@_jit
def _chunk(x, product, used, y):
    """The first `used` entries of a chunk's product into y, four states at a time."""
    one = x.shape[0] - 1
    last = product[one]
    for k in range(used):
        y[k] = last[k]
    j = 0
    while j + 3 < one:
        a, b, c, d = x[j], x[j + 1], x[j + 2], x[j + 3]
        by_a, by_b, by_c, by_d = product[j], product[j + 1], product[j + 2], product[j + 3]
        for k in range(used):
            y[k] += by_a[k] * a + by_b[k] * b + by_c[k] * c + by_d[k] * d
        j += 4
    while j < one:
        a = x[j]
        by_a = product[j]
        for k in range(used):
            y[k] += by_a[k] * a
        j += 1


@_jit
def _safe(x, product, first, rows, derivatives, reach, line):
    """How many leading samples of a chunk keep all inequalities, also between samples.

    Those that are out of reach do, whatever the samples are; of the others the values at the samples tell, and between
    them their second difference.
    """
    n = x.shape[0]
    safe = CHUNK
    for r in range(rows):
        older = 0.0
        change = 0.0
        for j in range(n):
            older += derivatives[0, r, j] * x[j]
            change += reach[r, j] * abs(x[j])
        if older > change:
            continue
        base = first + CHUNK * r
        for s in range(CHUNK):
            line[s] = 0.0
        for j in range(n):
            for s in range(CHUNK):
                line[s] += product[j, base + s] * x[j]
        step = line[0] - older
        bend = 0.0
        low = older
        for s in range(1, CHUNK):
            new = line[s] - line[s - 1]
            bend = max(bend, abs(new - step))
            step = new
        for s in range(CHUNK):
            low = min(low, line[s])
        if low < bend:
            if older < bend:
                return 0
            s = 0
            while s < safe and line[s] >= bend:
                s += 1
            safe = s
    return safe


@_jit
def _turn_signals(x, moving, step, count, spare):
    """Advance the signals alone by `count` steps; they do not depend on the motion."""
    n = x.shape[0]
    for _ in range(count):
        for i in range(moving, n - 1):
            total = 0.0
            for j in range(moving, n):
                total += step[i, j] * x[j]
            spare[i] = total
        for i in range(moving, n - 1):
            x[i] = spare[i]


@_jit
def _switch(x, scale, mode, row, tables, spare):
    """Enter the first learnt mode that holds after `row` of `mode` broke; return it, or -1."""
    counts, derivatives, strict, stops, stop_counts, enter, follow = tables
    for k in range(follow.shape[2]):
        new = follow[mode, row, k]
        if new < 0:
            return -1
        if not resting(x, scale, stops[new], stop_counts[new]):
            continue
        for i in range(x.shape[0]):
            total = 0.0
            for j in range(x.shape[0]):
                total += enter[new, i, j] * x[j]
            spare[i] = total
        if holding(spare, scale, derivatives[new], strict[new], counts[new]) < 0:
            for i in range(x.shape[0]):
                x[i] = spare[i]
            return new
    return -1


@_jit
def advance(
    h, count, x, scale, state, clock, stop_sample, stop_offset, stop_values,
    matrices, steps, lengths, rates, products, reaches, tables, out, modes, log_where, log_modes,
):  # fmt: skip
    """Advance to the end of the block, or to where the caller is needed: ASK for a mode that is not learnt.

    The row that broke is the number of an inequality, or one more than there are where something has to be zero and no
    longer is, which happens only as signals begin anew.

    Shapes: x (n,), out (count, moving), modes (count,), products (modes, n, width), reaches (modes, rows, n): the first
    `moving` states are angles and speeds, then come the signals, then one. Stops are instants at which the signals'
    pieces begin anew, with sample interval, offset in it and values.
    """
    counts, derivatives, strict, stops, stop_counts, enter = tables[:6]
    n = x.shape[0]
    moving = out.shape[1]
    y = np.empty(products.shape[2])
    line = np.empty(CHUNK)
    spare = np.empty(n)
    terms = np.empty((ORDER + 1, n))
    c = np.empty(ORDER + 1)
    flat = out.reshape(-1)
    i = state[SAMPLE]
    mode = state[MODE]
    stop = state[STOP]
    logged = state[LOGGED]
    events = state[EVENTS]
    s = clock[0]
    status = DONE
    asked = -1
    check = state[CHECK] == 1
    while i < count:
        next_stop = stop_sample[stop] if stop < stop_sample.shape[0] else count + CHUNK
        room = min(next_stop, count) - i
        if not check and s == 0.0 and room > 0 and lengths[mode] == h:
            used = CHUNK * moving + n - 1 - moving
            safe = _safe(x, products[mode], used, counts[mode], derivatives[mode], reaches[mode], line)
            safe = min(room, safe)
            if safe > 0:
                _chunk(x, products[mode], used, y)
                base = i * moving
                for k in range(safe * moving):
                    flat[base + k] = y[k]
                if safe == CHUNK:
                    for j in range(moving, n - 1):
                        x[j] = y[CHUNK * moving + j - moving]
                else:
                    _turn_signals(x, moving, steps[mode], safe, spare)
                for j in range(moving):
                    x[j] = y[(safe - 1) * moving + j]
                for j in range(n):
                    scale[j] = max(scale[j], abs(x[j]))
                for k in range(safe):
                    modes[i + k] = mode
                i += safe
                continue
        if not check:
            events = 0
        # one sample interval with care
        crossed = -1
        while True:
            if check:
                check = False
                for a in range(n):  # what has no inertia follows a signal at once
                    total = 0.0
                    for b in range(n):
                        total += enter[mode, a, b] * x[b]
                    spare[a] = total
                crossed = holding(spare, scale, derivatives[mode], strict[mode], counts[mode])
                if crossed < 0 and not resting(x, scale, stops[mode], stop_counts[mode]):
                    crossed = counts[mode]
                if crossed < 0:
                    for a in range(n):
                        x[a] = spare[a]
            if crossed >= 0:
                events += 1
                if events > MAX_EVENTS:
                    status = STORM
                    break
                if logged >= log_where.shape[0]:
                    status = LOG_FULL
                    check = True
                    break
                enlarge(x, scale, matrices[mode], moving, rates[mode])
                new = _switch(x, scale, mode, crossed, tables, spare)
                if new < 0:
                    status = ASK
                    asked = crossed
                    check = True
                    break
                log_where[logged, 0] = i
                log_where[logged, 1] = s
                log_modes[logged, 0] = mode
                log_modes[logged, 1] = new
                logged += 1
                mode = new
                crossed = -1
            is_stop = next_stop == i
            bound = min(stop_offset[stop], h) if is_stop else h
            dt = min(lengths[mode], bound - s)
            if dt > 0.0:
                if dt == lengths[mode]:
                    for a in range(n):
                        total = 0.0
                        for b in range(n):
                            total += steps[mode, a, b] * x[b]
                        spare[a] = total
                    ready = False
                else:
                    _series(matrices[mode], x, terms)
                    _evaluate(terms, dt, spare)
                    ready = True
                if _any_suspicious(x, spare, scale, dt, derivatives[mode], counts[mode]):
                    if not ready:
                        _series(matrices[mode], x, terms)
                    crossed, when = _crossing(terms, x, spare, derivatives[mode], scale, counts[mode], dt, c)
                    if crossed >= 0:
                        _evaluate(terms, when, x)
                        s += when
                        continue
                for a in range(n):
                    x[a] = spare[a]
                s = bound if dt == bound - s else s + dt
            if s >= bound:
                if is_stop:
                    for j in range(stop_values.shape[1]):
                        x[moving + j] = stop_values[stop, j]
                    stop += 1
                    next_stop = stop_sample[stop] if stop < stop_sample.shape[0] else count + CHUNK
                    check = True
                    continue
                if s >= h:
                    break
        if status != DONE:
            break
        for j in range(n):
            scale[j] = max(scale[j], abs(x[j]))
        for j in range(moving):
            out[i, j] = x[j]
        modes[i] = mode
        s = 0.0
        i += 1
    state[SAMPLE] = i
    state[MODE] = mode
    state[STOP] = stop
    state[LOGGED] = logged
    state[ROW] = asked
    state[EVENTS] = events
    state[CHECK] = 1 if check else 0
    clock[0] = s
    return status
