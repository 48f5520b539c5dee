"""Shares that the parts of a surface shader have in it, which may differ from point to point: by masks, alphas of images, ramps."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Share:
    """A product of numbers that nodes compute. @param terms  (plug, what is meant: its value as a SHARE, what it leaves to 1, or any
    NUMBER), ..."""

    SHARE, REST, NUMBER = "share", "rest", "number"
    terms: tuple = ()

    def times(self, plug, meant=SHARE):
        return Share((*self.terms, (plug, meant)))

    def of(self, values):
        """(N,), or a number where it is the same for all points. @param values  node_values.Values"""
        product = 1.0
        for plug, meant in self.terms:
            number = np.maximum(values.number(plug), 0)
            if meant != self.NUMBER:
                number = np.minimum(number, 1)
            product = product * (1 - number if meant == self.REST else number)
        return product

    def without(self, plugs):
        keys = {plug.key() for plug in plugs}
        return Share(tuple(term for term in self.terms if term[0].key() not in keys))

    def plugs(self):
        return [plug for plug, _ in self.terms]

    def with_plugs(self, change):
        """@param change  function of a plug: that which takes its place"""
        return Share(tuple((change(plug), meant) for plug, meant in self.terms))


class Blend:
    """A colour that is a sum of colours by their shares. @param parts  (Share, plug of a colour or three numbers, gain), ...
    @param over   Rest that they are shares of, or None: of 1"""

    def __init__(self, parts, over=None):
        self.parts, self._over = parts, over

    def of(self, values):
        """(N, 3), or (3,)."""
        total = self._sum(values, lambda share: share)
        if self._over is None:
            return total
        over = self._over.of(values)
        # Where there is nothing to have a share of, what its neighbours have, which look-ups between both need.
        beside = self._sum(values, lambda share: share.without(self._over.plugs()))
        return np.where(over > 1e-4, total / np.maximum(over, 1e-4), beside)

    def _sum(self, values, shared):
        total = np.zeros(3)
        for share, colour, gain in self.parts:
            own = np.asarray(colour) if _is_known(colour) else values.colour(colour)
            total = total + gain * np.asarray(shared(share).of(values))[..., None] * own
        return total

    def plugs(self):
        own = []
        for share, colour, _ in self.parts:
            own += share.plugs() + ([] if _is_known(colour) else [colour])
        return own + (self._over.plugs() if self._over is not None else [])

    def with_plugs(self, change):
        parts = [(share.with_plugs(change), c if _is_known(c) else change(c), gain) for share, c, gain in self.parts]
        return Blend(parts, self._over and self._over.with_plugs(change))


class Rest:
    """What a sum of shares leaves of 1: the alpha of a surface, where they are those of its transparent parts."""

    def __init__(self, parts):
        self._sum = Blend(parts)

    def of(self, values):
        """Grey, (N, 3), or (3,)."""
        left = 1 - self._sum.of(values).mean(-1, keepdims=True)
        return np.clip(np.repeat(left, 3, -1), 0, 1)

    def plugs(self):
        return self._sum.plugs()

    def with_plugs(self, change):
        return Rest(self._sum.with_plugs(change).parts)


def _is_known(colour):
    return isinstance(colour, (list, np.ndarray))
