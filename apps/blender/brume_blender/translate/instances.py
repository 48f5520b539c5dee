"""Volumes that stand at many places: one volume of brume's, and a table of the places (docs/instances.md).

Instances of collections, of geometry nodes, of vertices and particles, and objects that share their data, become places of the
first of them: where what their shader computes does not depend on where they are, or only by a factor on density and colour.
"""

import hashlib

import numpy as np

from .notes import LeftOut
from .toml_text import Table

MOST_COPIES = 256  # places of a volume that emits, is coloured, or is blurred by velocities: it takes as much as so many volumes
MEDIUM = ("sigma_t", "sigma_s", "sigma_a", "phase", "g", "g2", "lobe_weight", "albedo_grid")
GLOW = ("emission", "flame_grid", "flame_ramp", "temperature_grid", "temperature_scale", "blackbody_intensity", "blackbody_law")
GLOWS_BY = ("emission", "flame_grid", "temperature_grid")


class Standing:
    """One volume and where it stands. @param tables  [[volumes]] of the first place   @param matrix  of the first place
    @param factor  on all that its shader computes there"""

    def __init__(self, tables, matrix, factor):
        self.tables, self.glows = tables, any(table.holds_any(GLOWS_BY) for table in tables)
        self._back, self._factor = np.linalg.inv(np.array(matrix)), factor
        self._places = []
        coloured = any(table.value("sigma_s") is not None and not _is_grey(table) for table in tables)
        blurred = any(table.value("velocity_grid") for table in tables)
        self._most = MOST_COPIES if self.glows or coloured or blurred else None
        self.add(matrix, factor)

    def takes(self, factor):
        """Whether another place may be one of its own."""
        full = self._most is not None and len(self._places) >= self._most
        # Brume's factor on density leaves what glows as it is.
        return not full and not (self.glows and abs(factor - self._factor) > 1e-6 * self._factor)

    def add(self, matrix, factor, tint=(1, 1, 1)):
        self._places.append((*(np.array(matrix) @ self._back)[:3].ravel(), factor / self._factor, *tint))

    def rows(self):
        """(n, 16): three rows of a matrix that leads from the first place to each, factor on density, and on albedo."""
        return np.array(self._places)


class Instances:
    """All volumes of a translation that may stand at several places."""

    def __init__(self):
        self._known = {}  # by key: Standing, or why a volume is none
        self._all = []

    def tables(self, key, matrix, factor, make):
        """[[volumes]] of one more place; none where it is a place of a volume that is there already.
        @param key  equal for what is equal but for its place   @param factor  on all that its shader computes
        @param make  function that returns the tables, and whether others of the key are the same elsewhere   @throws LeftOut"""
        known = self._known.get(key)
        if isinstance(known, str):
            raise LeftOut(known)
        if known is not None and known.takes(factor):
            known.add(matrix, factor)
            return []
        try:
            tables, anywhere = make()
        except LeftOut as reason:
            self._known[key] = str(reason)  # an error would keep all that called alive
            raise
        if not anywhere:
            return self._by_factor(key, matrix, tables)
        if tables:
            self._stand(key, tables, matrix, factor)
        return tables

    def _stand(self, key, tables, matrix, factor):
        self._known[key] = Standing(tables, matrix, factor)
        self._all.append(self._known[key])

    def _by_factor(self, key, matrix, tables):
        """Of a place whose shader computes something else than at others: as a factor, where that is all."""
        if len(tables) != 1 or tables[0].value("sigma_s") is None or tables[0].holds_any(GLOWS_BY) or not _is_grey(tables[0]):
            return tables
        scattered = np.broadcast_to(np.asarray(tables[0].value("sigma_s"), float), 3)
        sigma_t = float((scattered + tables[0].value("sigma_a")).mean())
        if not sigma_t > 0:
            return tables
        key = (key, tables[0].text_without(("sigma_s", "sigma_a", "object_to_world")), tuple(scattered > 0))
        known = self._known.get(key)
        if known is None:
            self._stand(key, tables, matrix, sigma_t)
            return tables
        first = known.tables[0].value("sigma_s") / np.mean(np.add(known.tables[0].value("sigma_s"), known.tables[0].value("sigma_a")))
        known.add(matrix, sigma_t, np.where(scattered > 0, scattered / sigma_t / np.where(first > 0, first, 1), 1))
        return []

    def placed(self, tables, folder):
        """All tables of a scene, with [[instances]]. @param folder  for the files"""
        many = [standing for standing in self._all if len(standing.rows()) > 1]
        # What glows takes as much as so many volumes; what scatters beside it need not.
        for standing in many:
            apart = [_glow_apart(table) for table in standing.tables if table.holds_any(GLOWS_BY) and table.holds_any(MEDIUM[1:3])]
            standing.tables = standing.tables + apart
            tables = tables + apart
        numbers = {id(table): number for number, table in enumerate(t for t in tables if t.header == "[[volumes]]")}
        for standing in many:
            path = _file(standing.rows(), folder)
            for table in standing.tables:
                if id(table) in numbers:  # a world's volume takes some away
                    tables = [*tables, Table("[[instances]]").set(volume=numbers[id(table)], file=folder.named(path))]
        return tables


def _glow_apart(table):
    """Takes what glows out of a table. @return a table of it alone"""
    glow = table.without(MEDIUM).set(sigma_t=0)
    table.remove((*GLOW, "group"))
    return glow


def _is_grey(table):
    sums = np.broadcast_to(table.value("sigma_s"), 3) + np.broadcast_to(table.value("sigma_a"), 3)
    return np.ptp(sums) <= 0.9e-6 * sums.max()  # brume takes such sums as one number


def _file(rows, folder):
    """A PLY with a point for each place."""
    data = np.ascontiguousarray(rows, "<f8").tobytes()
    key = ("places", hashlib.sha1(data).hexdigest())
    if key not in folder.written:
        names = [f"m{i // 4}{i % 4}" for i in range(12)] + ["density", "tint.r", "tint.g", "tint.b"]
        header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
        header += [f"property double {name}" for name in names] + ["end_header", ""]
        folder.written[key] = folder.new(".ply", "places")
        with open(folder.written[key], "wb") as out:
            out.write("\n".join(header).encode() + data)
    return folder.written[key]
