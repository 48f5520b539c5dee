"""Renders OpenVDB smoke and clouds without bias, and removes Monte Carlo noise from media passes.

    import brume
    frame = brume.render("cloud.toml", spp=16, clean=True)
    brume.write("cloud.exr", frame)
    clean = brume.denoise(brume.read("noisy.exr"), "nl_means", search_radius=7)
    print(brume.metrics(clean, brume.read("reference.exr"))["lab_rms"])

Errors are brume.InputError. What the command line tells as a note goes to the logger "brume" as a warning, what
--quiet would silence as information. docs/python.md says more.
"""

from ._brume import (
    InputError,
    Layers,
    __commit__,
    __version__,
    denoise,
    filters,
    metrics,
    read,
    render,
    write,
)

__all__ = ["InputError", "Layers", "denoise", "filters", "metrics", "read", "render", "write"]

for _value in (Layers, denoise, filters, metrics, read, render, write):
    _value.__module__ = "brume"
