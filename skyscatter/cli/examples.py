"""Examples in the help of every command."""

from __future__ import annotations

EXAMPLES: dict[str, tuple[str, ...]] = {
    "sky": (
        "skyscatter sky earth --sun-elevation 5 -o sunset.png",
        "skyscatter sky mars --solver path --noise 1% --wavelengths 450,550,650 -o mars.exr --checkpoint 10min",
    ),
    "flux": (
        "skyscatter flux earth --altitude 0,5km,10km --sun-elevation 10:90:20 -o fluxes.csv",
        "skyscatter flux earth-hazy --wavelengths 550 --json",
    ),
    "export": (
        "skyscatter export earth --to three -o earth-three",
        "skyscatter export mars --to three --wavelengths 400:700:50 -o mars-three --json",
    ),
    "view": ("skyscatter view", "skyscatter view ring-nebula --no-open --port 8050 --keep"),
    "nebula": (
        "skyscatter nebula ring-nebula --size 128x128 --palette hoo -o ring.png",
        "skyscatter nebula hii-region --look hubble -o pillars.png",
        "skyscatter nebula reflection-nebula --samples 64 --wavelengths 400:700:50 -o nebula.fits --progress log",
        "skyscatter nebula dark-globule --samples 32 --denoise -o globule.png -o globule.fits",
    ),
    "render": (
        "skyscatter render fog-room --size 160x120 --preview -o room.png",
        "skyscatter render searchlight --solver photons --samples 64 -o beam.exr --no-clobber",
        "skyscatter render milk-and-water --solver path --samples 64 --denoise -o milk.png -o milk.exr",
    ),
    "dehaze": (
        "skyscatter dehaze hazy.png -o clear.png --transfer srgb",
        "skyscatter dehaze image.tif --sensor sentinel-2a --bands B02,B03,B04 --sun-zenith 30 --scale 0.0001 "
        "--offset 0 -o surface.tif --mask mask.tif --json",
    ),
    "invert": (
        "skyscatter invert earth-hazy --data sky.csv --free haze.optical_depth=0:2 -o fit.json",
        "skyscatter invert earth-hazy --data sky.csv --free haze.optical_depth --free ground.albedo "
        "--prior ground.albedo=0.2~0.05 --residual residual.png",
    ),
    "models": ("skyscatter models", "skyscatter models show titan"),
    "models new": ("skyscatter models new earth mine.toml", "skyscatter models new fog-room room.toml --force"),
    "models schema": ("skyscatter models schema -o skyscatter.json", "skyscatter models schema nebula > nebula.json"),
    "models reference": ("skyscatter models reference", "skyscatter models reference tabulated"),
    "models show": ("skyscatter models show mars", "skyscatter models show titan --plot titan.png"),
    "models check": ("skyscatter models check mine.toml", "skyscatter models check mine.toml --plot mine.svg"),
    "store": ("skyscatter store list run.zarr", "skyscatter store export run.zarr -o sky.fits"),
    "store list": ("skyscatter store list run.zarr", "skyscatter store list run.zarr --json"),
    "store verify": ("skyscatter store verify run.zarr", "skyscatter store verify run.zarr --repair"),
    "store export": ("skyscatter store export run.zarr -o sky.png", "skyscatter store export run.zarr -o sky.nc"),
    "warm": ("skyscatter warm sky", "skyscatter warm all --progress log"),
    "info": ("skyscatter info", "skyscatter info > report.txt"),
}


def epilog(command: str) -> str:
    """The end of a command's help."""
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in EXAMPLES[command])])
