"""Particles drawn as the material they stand for, nearest to the viewer in front.

Every particle is a disc, or in space a ball, of the size of the material it stands for, and gaps of
less than a cell and a half between particles of a body are closed. So a body is a surface and not a
cloud of dots, whatever the size of the picture, and where a flow has pulled particles apart without
parting the water. In space what is behind something is hidden by it, and surfaces are lit
(`pixels.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import PathCollection
from matplotlib.colors import to_rgb
from matplotlib.image import BboxImage
from matplotlib.path import Path
from numpy.typing import NDArray

from libmpm._src.pictures.pixels import Painted, Pixels, halved

if TYPE_CHECKING:
    from libmpm._src.pictures.directions import View

__all__ = ["Layer", "Splats", "Surface"]

Array = NDArray[np.float64]

#: Pixels of the buffer up to which every pixel of the picture is taken twice each way.
_FINE = 3_000_000


class Splats(PathCollection):
    """The particles of one body in a panel: offsets, colours and norm of a scatter.

    `radius` is that of a particle, m, `gap` m what is closed around it, `depth` (n,) m towards the
    viewer. The `Layer` of its panel draws it.
    """

    def __init__(self, name: str, *, solid: bool, colour: str) -> None:
        """Take no particles yet."""
        super().__init__([Path.unit_circle()], sizes=[1.0], offsets=np.empty((0, 2)))
        self.set_label(name)
        self.set_facecolor(colour)
        self.radius = 0.0
        self.gap = 0.0
        self.solid = solid
        self.plain = colour
        self.depth: Array = np.empty(0)
        self._placed = 0

    def place(
        self, flat: Array, depth: Array, values: Array | None, radius: float, gap: float
    ) -> None:
        """Take positions (n, 2) m in the picture, depths (n,) m, what colours them, and sizes m."""
        self.set_offsets(flat)
        self.depth = depth
        self.set_array(values)
        self.radius, self.gap = radius, gap
        self._placed += 1

    def draw(self, renderer: Any) -> None:
        """Leave it to the layer."""

    def state(self) -> tuple[Any, ...]:
        """Return what tells apart two states in which it looks different."""
        return self._placed, self.get_visible(), self.norm.vmin, self.norm.vmax, self.cmap.name

    def colours(self) -> Array:
        """Return the colour (n, 3) of every particle."""
        values = self.get_array()
        if values is None:
            return np.broadcast_to(np.array(to_rgb(self.plain)), (len(self.depth), 3))
        return np.asarray(self.to_rgba(values))[:, :3]


@dataclass(frozen=True)
class Surface:
    """A structure in space: a box by its corners, or points (n, 3) m on a surface.

    `spacing` is the distance between neighbouring points, m.
    """

    colour: str
    lower: Array | None = None
    upper: Array | None = None
    points: Array | None = None
    spacing: float = 0.0


class Layer(Artist):
    """All bodies and structures of a panel, drawn together.

    `lit`: surfaces are shaded by the light. `clip` (2, 2) m: nothing of a particle is drawn outside
    of this rectangle of the picture.
    """

    def __init__(self, view: View, *, lit: bool, clip: Array | None = None) -> None:
        """Take how the panel looks at the scene."""
        super().__init__()
        self.view = view
        self.bodies: list[Splats] = []
        self.surfaces: list[Surface] = []
        #: Rectangles (2, 2) m, like `clip`, that structures fill: nothing is drawn in them.
        self.blocked: list[Array] = []
        self._lit, self._clip = lit, clip
        self._drawn: tuple[Any, Array] | None = None
        self.set_zorder(2)

    def add(self, axes: Any, body: Splats) -> Splats:
        """Put a body into the panel `axes`."""
        if self.axes is None:
            axes.add_artist(self)
        body.set_offset_transform(axes.transData)
        axes.add_collection(body, autolim=False)
        self.bodies.append(body)
        return body

    def draw(self, renderer: Any) -> None:
        """Draw at the resolution of the figure."""
        if self.axes is None or not self.get_visible():
            return
        box = self.axes.bbox
        size = np.ceil([box.width, box.height]).astype(int)
        if np.any(size < 2):
            return
        limits = np.array([self.axes.get_xlim(), self.axes.get_ylim()])
        # A figure is drawn once for its layout and once for its file.
        state = (*size, *limits.ravel(), *(body.state() for body in self.bodies))
        if self._drawn is None or self._drawn[0] != state:
            self._drawn = state, self._image(limits, size)
        artist = BboxImage(box, origin="lower", interpolation="antialiased")
        artist.set_data(self._drawn[1])
        artist.set_zorder(self.get_zorder())
        figure = self.get_figure()
        if figure is not None:
            artist.set_figure(figure)
        artist.draw(renderer)

    def _image(self, limits: Array, size: NDArray[np.int_]) -> Array:
        """Return the picture (height, width, 4) of all bodies and structures."""
        fine = 2 if 4 * size[0] * size[1] <= _FINE else 1
        pixels = Pixels(limits, size[0] * fine, size[1] * fine, self._clip, self.blocked)
        painted = []
        for body in self.bodies:
            painted.append(Painted(body.colours(), body.solid))
            if body.get_visible() and len(body.depth):
                flat = np.asarray(body.get_offsets())
                pixels.body(flat, body.depth, body.radius, body.gap, len(painted) - 1)
        for surface in self.surfaces:
            painted.append(Painted(np.array([to_rgb(surface.colour)]), True))
            if surface.points is not None:
                flat, depth = self.view.project(surface.points)
                pixels.body(flat, depth, 0.8 * surface.spacing, 0.0, len(painted) - 1)
            elif surface.lower is not None and surface.upper is not None:
                pixels.box(self.view, surface.lower, surface.upper, len(painted) - 1)
        image = pixels.image(painted, lit=self._lit)
        return halved(image) if fine == 2 else image
