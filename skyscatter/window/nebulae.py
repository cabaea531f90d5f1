"""What a page asks about a nebula: pictures that become better pass by pass, and the spectrum of a pixel."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.units import PARSEC
from skyscatter.window.asked import number, one_of, optional, whole
from skyscatter.window.work import Message, Told

if TYPE_CHECKING:
    from skyscatter.geometry.telescope import Telescope
    from skyscatter.image.spectral import SpectralImage
    from skyscatter.space import SpaceScene

WAVELENGTHS = np.arange(380.0, 781.0, 10.0)
#: Walks a pixel of the passes: the first two are of small pictures, the others add up.
COARSE, SAMPLES = ((8, 2), (3, 2)), (2, 2, 4, 8, 16, 32)
#: Smallest and largest picture [pixel].
LEAST, MOST = 16, 1024


class Side(NamedTuple):
    """A nebula as it is seen from one side."""

    model: str
    inclination: float
    azimuth: float
    width_pc: float
    size: tuple[int, int]

    def scene(self) -> SpaceScene:
        """The nebula, turned."""
        from skyscatter.models.files import load_model
        from skyscatter.models.nebula import NebulaModel

        model = load_model(self.model)
        assert isinstance(model, NebulaModel)  # the models of nebulae are
        return model.scene(inclination_deg=self.inclination, azimuth_deg=self.azimuth)

    def camera(self, scene: SpaceScene, share: int = 1) -> Telescope:
        """The telescope, or one whose pixels are `share` times as wide."""
        from skyscatter.geometry.telescope import Telescope

        width, height = (max(side // share, 1) for side in self.size)
        return Telescope.from_length(width, height, self.width_pc * PARSEC, scene.view.distance)


class Mean:
    """The mean of pictures of the same side, each of other walks, by their numbers."""

    def __init__(self) -> None:
        self.samples = 0
        self.radiance: NDArray[np.float64] = np.zeros(())
        self._variance: NDArray[np.float64] = np.zeros(())

    def add(self, image: SpectralImage, samples: int) -> None:
        """Another picture; errors of independent pictures add up in squares."""
        total = self.samples + samples
        old, new = self.samples / total, samples / total
        assert image.standard_error is not None  # `path` states it
        self.radiance = old * self.radiance + new * image.radiance
        self._variance = old**2 * self._variance + (new * image.standard_error) ** 2
        self.samples = total

    def image(self, like: SpectralImage) -> SpectralImage:
        """The mean as a picture."""
        from skyscatter.image.spectral import SpectralImage

        return SpectralImage(self.radiance, like.wavelengths, np.sqrt(self._variance), recipe=like.recipe)


class Nebulae:
    """Answers about nebulae of some models."""

    def __init__(self, models: Callable[[], tuple[str, ...]]) -> None:
        self._models = models
        self._last: SpectralImage | None = None

    def side(self, question: Message) -> Side:
        """From where a question looks."""
        return Side(
            one_of(question, "model", self._models()),
            number(question, "inclination", -360.0, 360.0),
            number(question, "turn", -360.0, 360.0),
            number(question, "fieldWidth", 1e-9, 1e6),
            (whole(question, "width", LEAST, MOST), whole(question, "height", LEAST, MOST)),
        )

    def picture(self, question: Message, told: Told) -> Iterator[tuple[Message, bytes]]:
        """Pictures, better from pass to pass; each is followed by its numbers."""
        side = self.side(question)
        exposure = optional(question, "exposure", -30.0, 30.0)
        scene = side.scene()
        for share, samples in COARSE:
            image = _render(scene, side.camera(scene, share), samples, 0, told)
            yield from self._said(image, samples, share, exposure)
        mean = Mean()
        for seed, samples in enumerate(SAMPLES):
            image = _render(scene, side.camera(scene), samples, seed, told)
            mean.add(image, samples)
            yield from self._said(mean.image(image), mean.samples, 1, exposure)

    def _said(
        self, image: SpectralImage, samples: int, share: int, exposure: float | None
    ) -> Iterator[tuple[Message, bytes]]:
        from skyscatter.image.png import encode_png

        self._last = image
        height, width, _ = image.shape
        xyz, error = image.xyz(), luminance_error(image)
        picture, ev100 = image.developed("srgb", "auto" if exposure is None else exposure, "photograph")
        bright = xyz[..., 1] > 0.01 * xyz[..., 1].max()
        about = {
            "width": width, "height": height, "samples": samples, "share": share, "exposure": ev100,
            "noise": float(np.median(error[bright] / xyz[bright, 1])) if bright.any() else 0.0,
        }  # fmt: skip
        yield {"what": "picture", **about}, encode_png(picture, dither=True)
        yield {"what": "numbers", **about}, np.dstack([xyz, error]).astype("<f4").tobytes()

    def point(self, question: Message, told: Told) -> Iterator[tuple[Message, None]]:
        """The spectrum of a pixel of the last picture, by its place from 0 to 1, with its standard error."""
        image = self._last
        if image is None:
            return
        from skyscatter.image.colour import spectrum_to_xyz

        height, width, _ = image.shape
        x = min(int(number(question, "x", 0.0, 1.0) * width), width - 1)
        y = min(int(number(question, "y", 0.0, 1.0) * height), height - 1)
        error: Any = image.standard_error
        yield (
            {
                "what": "spectrum",
                "wavelengths": image.wavelengths.tolist(),
                "radiance": image.radiance[y, x].tolist(),
                "error": error[y, x].tolist(),
                "kind": "standard error",
                "xyz": spectrum_to_xyz(image.radiance[y, x], image.wavelengths).tolist(),
            },
            None,
        )

    def command(self, question: Message, told: Told) -> Iterator[tuple[Message, None]]:
        """The command that makes the picture, with as many walks as the page has by now."""
        side, exposure = self.side(question), optional(question, "exposure", -30.0, 30.0)
        words = ["skyscatter", "nebula", side.model, "--inclination", f"{side.inclination:.6g}"]
        words += ["--azimuth", f"{side.azimuth:.6g}", "--field-of-view", f"{side.width_pc:.6g}pc"]
        words += ["--size", "{}x{}".format(*side.size), "--samples", str(whole(question, "samples", 2, sum(SAMPLES)))]
        words += [] if exposure is None else ["--exposure", f"{exposure:.6g}"]
        yield {"what": "command", "command": shlex.join([*words, "-o", "nebula.png"])}, None


def luminance_error(image: SpectralImage) -> NDArray[np.float64]:
    """Standard error of the luminance [cd m-2] at most, shape (y, x).

    Wavelengths share their walks, so that their errors go together: as far as they can, here.
    """
    from skyscatter.image.colour import xyz_weights

    error: Any = image.standard_error
    return np.asarray(error @ xyz_weights(image.wavelengths)[:, 1])


def _render(scene: SpaceScene, camera: Telescope, samples: int, seed: int, told: Told) -> SpectralImage:
    from skyscatter.solvers.options import Path
    from skyscatter.solvers.render import render

    words = f"{camera.width} × {camera.height} pixels, {samples} walks each"
    told(0.0, words)
    walks = Path(samples=samples, seed=seed)
    return render(scene, camera, WAVELENGTHS, solver=walks, progress=lambda share: told(share, words))
