"""Blender's procedural textures in NumPy: noise, Musgrave, Voronoi, waves and patterns, at points of one to four coordinates.

Lattice noise is Perlin's with Blender's scale factors; cells are hashed by Jenkins' lookup3 (burtleburtle.net/bob/c/lookup3.c).
Proof: tests/blender/nodes_test.py, against what Cycles renders.
"""

import itertools

import numpy as np

CHUNK = 1 << 15  # points at once: what fits caches
SNOISE_SCALE = {1: 0.25, 2: 0.6616, 3: 0.9820, 4: 0.8344}
MOST_OCTAVES = 15


# Hashes


def _rot(x, k):
    return (x << np.uint32(k)) | (x >> np.uint32(32 - k))


def hash_of(*keys):
    """lookup3's hash of one to four arrays of uint32."""
    seed = np.full_like(keys[0], 0xDEADBEEF + (len(keys) << 2) + 13)
    a, b, c = (keys[i] + seed if i < len(keys) else seed for i in range(3))
    if len(keys) == 4:
        for k, l, m in ((4, 6, 8), (16, 19, 4)):
            a = (a - c) ^ _rot(c, k)
            c = c + b
            b = (b - a) ^ _rot(a, l)
            a = a + c
            c = (c - b) ^ _rot(b, m)
            b = b + a
        a = a + keys[3]
    c = (c ^ b) - _rot(b, 14)
    a = (a ^ c) - _rot(c, 11)
    b = (b ^ a) - _rot(a, 25)
    c = (c ^ b) - _rot(b, 16)
    a = (a ^ c) - _rot(c, 4)
    b = (b ^ a) - _rot(a, 14)
    return (c ^ b) - _rot(b, 24)


def _unit(*coordinates):
    """A number in [0, 1] by the bits of floats."""
    bits = [np.array(x, np.float32, ndmin=1).view(np.uint32) for x in np.broadcast_arrays(*coordinates)]
    return hash_of(*bits) / np.float64(0xFFFFFFFF)


def hashed(p, size):
    """`size` numbers in [0, 1] for each point. @param p  (N, dimensions)"""
    x = list(p.T)
    if len(x) < 4:
        return np.stack([_unit(*x), *(_unit(*x, float(i)) for i in range(1, size))], -1)
    orders = ((0, 1, 2, 3), (3, 0, 1, 2), (2, 3, 0, 1), (1, 2, 3, 0)) if size == 4 else ((0, 1, 2, 3), (2, 0, 3, 1), (3, 2, 1, 0))
    return np.stack([_unit(*(x[i] for i in order)) for order in orders[:size]], -1)


# PCG's two rounds, by dimensions: a number gets the product of two others, in the plane that of the other and the factor.
PCG_ROUND = {2: ((0, 1), (1, 0)), 3: ((0, 1, 2), (1, 2, 0), (2, 0, 1)), 4: ((0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2))}
PCG_FACTOR, PCG_MASK = np.int32(1664525), np.int32(0x7FFFFFFF)


def pcg_hashed(cells, size):
    """As hashed(), of whole numbers, as Voronoi textures have it since Blender 5.0. @param cells  (N, dimensions)
    Source: Jarzynski, Olano 2020, Hash Functions for GPU Rendering, on signed integers."""
    dimensions = cells.shape[1]
    if dimensions == 1:
        return hashed(cells, size)
    columns = list(cells.T.astype(np.int32)) + [np.zeros(len(cells), np.int32)] * (size - dimensions)
    v = [c * PCG_FACTOR + np.int32(1013904223) for c in columns]

    def turn():
        for to, *by in PCG_ROUND[len(v)]:
            v[to] = v[to] + (v[by[0]] * PCG_FACTOR if len(by) == 1 else v[by[0]] * v[by[1]])

    turn()
    v = [c ^ (c >> np.int32(16)) for c in v]
    turn()
    return (np.stack(v[:size], -1) & PCG_MASK) / np.float64(PCG_MASK)


def _around(cell, low, high, function):
    """Reads a function of whole cells around points: a function of an offset from `cell`. It is computed once for each cell where
    these are fewer than the points. @param low, high  the offsets that will be asked for   @param function  of (N, dimensions)"""
    first, last = cell.min(0) + low, cell.max(0) + high
    size = last - first + 1
    if not np.prod(size) <= len(cell):
        return lambda offset: function(cell + offset)
    table = function(np.stack(np.meshgrid(*map(np.arange, first, last + 1), indexing="ij"), -1).reshape(-1, cell.shape[1]))
    steps = np.append(np.cumprod(size[:0:-1])[::-1], 1)
    index = ((cell - first) @ steps).astype(np.int64)
    return lambda offset: table[index + int(offset @ steps)]


# Lattice noise


def _gradient(h, x):
    """Of a lattice point's hash, times the distance from it. @param x  list of coordinates"""
    signed = lambda value, bit: np.where(h & np.uint32(bit), -value, value)  # noqa: E731
    if len(x) == 1:
        return signed(1.0 + (h & np.uint32(7)), 8) * x[0]
    if len(x) == 2:
        low = (h & np.uint32(7)) < 4
        return signed(np.where(low, x[0], x[1]), 1) + signed(2 * np.where(low, x[1], x[0]), 2)
    if len(x) == 3:
        h = h & np.uint32(15)
        u = np.where(h < 8, x[0], x[1])
        v = np.where(h < 4, x[1], np.where((h == 12) | (h == 14), x[0], x[2]))
        return signed(u, 1) + signed(v, 2)
    h = h & np.uint32(31)
    u, v, s = np.where(h < 24, x[0], x[1]), np.where(h < 16, x[1], x[2]), np.where(h < 8, x[2], x[3])
    return signed(u, 1) + signed(v, 2) + signed(s, 4)


def _signed_noise(p):
    """In about [-1, 1]. @param p  (N, dimensions)"""
    cell = np.floor(p)
    hashes = _around(cell, 0, 1, lambda lattice: hash_of(*lattice.T.astype(np.int64).astype(np.uint32)))
    x = list((p - cell).T)
    fade = [t * t * t * (t * (t * 6 - 15) + 10) for t in x]
    values = []
    for corner in itertools.product((0, 1), repeat=len(x)):
        corner = np.array(corner[::-1])  # the first coordinate runs fastest
        values.append(_gradient(hashes(corner), [t - c for t, c in zip(x, corner)]))
    for t in fade:
        values = [(1 - t) * a + t * b for a, b in zip(values[::2], values[1::2])]
    return SNOISE_SCALE[len(x)] * values[0]


def signed_noise(p):
    """@param p  (N, dimensions)"""
    return _by_chunks(_signed_noise, p)


def _by_chunks(function, p, *more):
    """@param more  arrays of (N,), or numbers"""
    cut = lambda m, i: m[i : i + CHUNK] if np.ndim(m) else m  # noqa: E731
    parts = [function(p[i : i + CHUNK], *(cut(m, i) for m in more)) for i in range(0, max(len(p), 1), CHUNK)]
    return np.concatenate(parts) if isinstance(parts[0], np.ndarray) else tuple(np.concatenate(c) for c in zip(*parts))


def _offset(seed, dimensions):
    """Far from the origin, where noise is independent of that there."""
    if dimensions == 1:
        return 100 + 100 * _unit(float(seed))
    return np.concatenate([100 + 100 * _unit(float(seed), float(i)) for i in range(dimensions)])


def _columns(*numbers):
    return [np.asarray(n, float)[..., None] for n in numbers]


def fractal(p, detail, roughness, lacunarity=2.0, normalised=True):
    """Octaves of noise, in [0, 1] where it is normalised. @param detail  octaves beyond the first, of any fraction"""
    detail, roughness = np.clip(detail, 0, MOST_OCTAVES), np.maximum(roughness, 0)
    total, amplitude, most, result = np.zeros(len(p)), np.ones(len(p)), np.zeros(len(p)), np.zeros(len(p))
    for octave in range(int(np.max(np.ceil(detail))) + 1):
        share = np.clip(detail - octave + 1, 0, 1)  # of this octave: the last one fades in
        total, most = total + signed_noise(p) * amplitude, most + amplitude
        so_far = total / most if normalised else total
        result = result + share * (so_far - result)
        amplitude = amplitude * roughness
        p = p * _columns(lacunarity)[0]
    return 0.5 * result + 0.5 if normalised else result


def noise(p, detail, roughness, distortion, colour, lacunarity=2.0, normalised=True):
    """Of the Noise Texture: (N,), or the colour of (N, 3)."""
    d = p.shape[1]
    if np.any(distortion):
        p = p + np.stack([signed_noise(p + _offset(i, d)) * distortion for i in range(d)], -1)
    offsets = [0.0] if not colour else [0.0, _offset(d, d), _offset(d + 1, d)]
    values = [fractal(p + offset, detail, roughness, lacunarity, normalised) for offset in offsets]
    return np.stack(values, -1) if colour else values[0]


def musgrave(kind, p, detail, dimension, lacunarity, offset, gain):
    """Of the Musgrave Texture. @param kind  as Blender names it"""
    detail, dimension, lacunarity = np.clip(detail, 0, MOST_OCTAVES), np.maximum(dimension, 1e-5), np.maximum(lacunarity, 1e-5)
    count, step = int(np.max(np.ceil(detail))), lacunarity ** -np.asarray(dimension)
    power = np.ones(len(p))
    value = np.zeros(len(p)) if kind == "FBM" else np.ones(len(p))
    if kind not in ("FBM", "MULTIFRACTAL"):
        first = signed_noise(p)
        value = offset + first if kind != "RIDGED_MULTIFRACTAL" else (offset - np.abs(first)) ** 2
        weight, signal = gain * value, value
    for octave in range(count):
        share = np.clip(detail - octave, 0, 1)
        if kind in ("FBM", "MULTIFRACTAL"):
            n = signed_noise(p)
            value = value + share * power * n if kind == "FBM" else value * (share * power * n + 1)
        elif octave > 0:
            n = signed_noise(p)
            if kind == "HETERO_TERRAIN":
                value = value + share * (n + offset) * power * value
            elif kind == "HYBRID_MULTIFRACTAL":
                signal = (n + offset) * power
                weight = np.where(weight > 0.001, np.minimum(weight, 1), 0)
                value = value + share * weight * signal
                weight = weight * gain * signal
            elif np.all(share >= 1):  # Blender's ridges have whole octaves
                signal = (offset - np.abs(n)) ** 2 * np.clip(signal * gain, 0, 1)
                value = value + signal * power
        p, power = p * _columns(lacunarity)[0], power * step
    return value


# Cells


def _distance(metric, v, exponent):
    if metric == "MANHATTAN":
        return np.abs(v).sum(-1)
    if metric == "CHEBYCHEV":
        return np.abs(v).max(-1)
    if metric == "MINKOWSKI":
        return (np.abs(v) ** _columns(exponent)[0]).sum(-1) ** (1 / np.asarray(exponent, float))
    return np.sqrt((v * v).sum(-1))


def _neighbours(cell, reach, randomness, hashes):
    """Each cell around: its own hash's key, and its point from this cell's corner."""
    dimensions = cell.shape[1]
    places = _around(cell, -reach, reach, lambda cells: hashes(cells, dimensions))
    for offset in itertools.product(range(-reach, reach + 1), repeat=dimensions):
        offset = np.array(offset[::-1], float)
        yield cell + offset, offset + places(offset) * _columns(randomness)[0]


def voronoi(feature, metric, p, smoothness, exponent, randomness, hashes=hashed):
    """Of the Voronoi Texture. @param hashes  hashed, or pcg_hashed   @return distance (N,), colour (N, 3), position (N, dimensions)"""
    return _by_chunks(lambda *a: _voronoi(feature, metric, hashes, *a), p, smoothness, exponent, randomness)


def _voronoi(feature, metric, hashes, p, smoothness, exponent, randomness):
    randomness = np.clip(randomness, 0, 1)
    cell = np.floor(p)
    local = p - cell
    if feature == "SMOOTH_F1":
        return _smooth_voronoi(metric, hashes, cell, local, np.clip(np.asarray(smoothness) / 2, 0, 0.5), exponent, randomness)
    if feature == "DISTANCE_TO_EDGE":
        return _distance_to_edge(cell, local, randomness, hashes), np.zeros((len(p), 3)), np.zeros_like(p)
    if feature == "N_SPHERE_RADIUS":
        return _sphere_radius(cell, local, randomness, hashes), np.zeros((len(p), 3)), np.zeros_like(p)
    count = 1 if feature == "F1" else 2
    best = [(np.full(len(p), 8.0), np.zeros_like(p), np.zeros_like(p)) for _ in range(count)]  # distance, key, point
    for key, point in _neighbours(cell, 1, randomness, hashes):
        candidate = (_distance(metric, point - local, exponent), key, point)
        for place in range(count):
            nearer = candidate[0] < best[place][0]
            swap = [np.where(nearer if a.ndim == 1 else nearer[:, None], a, b) for a, b in zip(candidate, best[place])]
            candidate = [np.where(nearer if a.ndim == 1 else nearer[:, None], b, a) for a, b in zip(candidate, best[place])]
            best[place] = swap
    distance, key, point = best[-1]
    return distance, hashes(key, 3), point + cell


def _smooth_voronoi(metric, hashes, cell, local, smoothness, exponent, randomness):
    smoothness = np.broadcast_to(smoothness, len(cell))
    if np.all(smoothness == 0):
        smoothness = smoothness + 1e-12
    distance, colour, position = np.full(len(cell), 8.0), np.zeros((len(cell), 3)), np.zeros_like(cell)
    for key, point in _neighbours(cell, 2, randomness, hashes):
        at = _distance(metric, point - local, exponent)
        h = np.clip(0.5 + 0.5 * (distance - at) / smoothness, 0, 1)
        h = h * h * (3 - 2 * h)
        correction = smoothness * h * (1 - h)
        distance = (1 - h) * distance + h * at - correction
        correction, h = _columns(correction / (1 + 3 * smoothness), h)
        colour = (1 - h) * colour + h * hashes(key, 3) - correction
        position = (1 - h) * position + h * point - correction
    return distance, colour, cell + position


def _distance_to_edge(cell, local, randomness, hashes):
    closest, least = np.zeros_like(cell), np.full(len(cell), 8.0 if cell.shape[1] > 1 else np.inf)
    for _, point in _neighbours(cell, 1, randomness, hashes):
        to = point - local
        squared = (to * to).sum(-1)
        nearer = squared < least
        least, closest = np.where(nearer, squared, least), np.where(nearer[:, None], to, closest)
    if cell.shape[1] == 1:
        right, left = (cell + s + hashed(cell + s, 1) * _columns(randomness)[0] for s in (1, -1))
        middle, x = cell + hashed(cell, 1) * _columns(randomness)[0], cell + local
        return np.minimum(np.abs((middle + left) / 2 - x), np.abs((middle + right) / 2 - x))[:, 0]
    edge = np.full(len(cell), 8.0)
    for _, point in _neighbours(cell, 1, randomness, hashes):
        to = point - local
        across = to - closest
        squared = (across * across).sum(-1)
        distance = (0.5 * (closest + to) * across).sum(-1) / np.sqrt(np.maximum(squared, 1e-30))
        edge = np.where(squared > 1e-4, np.minimum(edge, distance), edge)
    return edge


def _sphere_radius(cell, local, randomness, hashes):
    points = list(_neighbours(cell, 1, randomness, hashes))
    distances = np.stack([_distance("EUCLIDEAN", point - local, 0) for _, point in points])
    nearest = np.argmin(distances, 0)
    keys, all_points = np.stack([k for k, _ in points]), np.stack([q for _, q in points])
    rows = np.arange(len(cell))
    key, point = keys[nearest, rows], all_points[nearest, rows]
    least = np.full(len(cell), 8.0)
    for other, at in _neighbours(key, 1, randomness, hashes):
        if np.array_equal(other, key):
            continue
        least = np.minimum(least, _distance("EUCLIDEAN", at - (point - (key - cell)), 0))
    return least / 2


# Patterns


def wave(kind, direction, profile, p, distortion, detail, detail_scale, detail_roughness, phase):
    p = (p + 1e-6) * 0.999999
    axes = "XYZ"
    if kind == "BANDS":
        n = p.sum(-1) * 10 if direction == "DIAGONAL" else p[:, axes.index(direction)] * 20
    else:
        kept = [i for i in range(3) if axes[i] != direction]
        n = np.linalg.norm(p[:, kept], axis=-1) * 20
    n = n + phase
    if np.any(distortion):
        n = n + distortion * (fractal(p * _columns(detail_scale)[0], detail, np.clip(detail_roughness, 0, 1)) * 2 - 1)
    if profile == "SIN":
        return 0.5 + 0.5 * np.sin(n - np.pi / 2)
    n = n / (2 * np.pi)
    return n - np.floor(n) if profile == "SAW" else 2 * np.abs(n - np.floor(n + 0.5))


def gradient(kind, p):
    x, y = p[:, 0], p[:, 1]
    if kind == "LINEAR":
        value = x
    elif kind == "QUADRATIC":
        value = np.maximum(x, 0) ** 2
    elif kind == "EASING":
        r = np.clip(x, 0, 1)
        value = r * r * (3 - 2 * r)
    elif kind == "DIAGONAL":
        value = 0.5 * (x + y)
    elif kind == "RADIAL":
        value = np.arctan2(y, x) / (2 * np.pi) + 0.5
    else:
        r = np.maximum(0.999999 - np.linalg.norm(p, axis=-1), 0)
        value = r * r if kind == "QUADRATIC_SPHERE" else r
    return np.clip(value, 0, 1)


# Magic: what each turn replaces, of which function, with the signs of x, y and z.
TURNS = (
    (1, "-cos", (1, -1, 1)), (0, "cos", (1, -1, -1)), (2, "sin", (-1, -1, -1)), (0, "-cos", (-1, 1, -1)), (1, "-sin", (-1, 1, 1)),
    (1, "-cos", (-1, 1, 1)), (0, "cos", (1, 1, 1)), (2, "sin", (1, 1, -1)), (0, "-cos", (-1, -1, 1)), (1, "-sin", (1, -1, 1)),
)  # fmt: skip


def magic(p, distortion, depth):
    """@return colour (N, 3)"""
    q = np.fmod(p, 2 * np.pi)
    x, y, z = q.T
    v = [np.sin((x + y + z) * 5), np.cos((-x + y - z) * 5), -np.cos((-x - y + z) * 5)]
    if depth > 0:
        v = [c * distortion for c in v]
    for place, function, signs in TURNS[:depth]:
        turned = getattr(np, function.lstrip("-"))(sum(s * c for s, c in zip(signs, v)))
        v[place] = (-turned if function[0] == "-" else turned) * distortion
    divisor = np.where(np.asarray(distortion) != 0, 2 * np.asarray(distortion), 1)
    return 0.5 - np.stack([c / divisor for c in v], -1)


def checker(p):
    """1 in every other cube."""
    cells = np.abs(np.floor((p + 1e-6) * 0.999999)).astype(np.int64) % 2
    return ((cells[:, 0] == cells[:, 1]) == (cells[:, 2] == 1)).astype(float)
