"""The pixels of a render: size, border. Knows NumPy and nothing of Blender but its settings' names."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Window:
    """The film, and the part of it that is rendered: rows counted from the top, the ends exclusive."""

    film_width: int
    film_height: int
    x0: int
    y0: int
    x1: int
    y1: int

    @property
    def width(self):
        return self.x1 - self.x0

    @property
    def height(self):
        return self.y1 - self.y0

    def is_whole(self):
        return (self.width, self.height) == (self.film_width, self.film_height)

    def crop(self):
        """As --crop takes it."""
        return f"{self.x0},{self.y0},{self.x1},{self.y1}"


def window_of(render, film_width, film_height):
    """@param render  the scene's settings   @param film_width, film_height  of the engine [px]"""
    if not render.use_border:
        return Window(film_width, film_height, 0, 0, film_width, film_height)

    def edge(share, size):
        return int(np.float32(share) * np.float32(size))  # as Blender rounds

    x0, x1 = edge(render.border_min_x, film_width), edge(render.border_max_x, film_width)
    low, high = edge(render.border_min_y, film_height), edge(render.border_max_y, film_height)
    return Window(film_width, film_height, x0, film_height - high, max(x1, x0 + 1), max(film_height - low, film_height - high + 1))
