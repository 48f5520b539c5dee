"""Makes a wheel of the Python package for pip (PEP 517): CMake builds it, and this packs what was built.

Settings (pip install . --config-settings KEY=VALUE): build-dir, the folder to build in, build/wheel without it; one that
CMake has configured already is taken as it is. jobs, compilations at once; all processors without it.
"""

import base64
import hashlib
import os
import pathlib
import shutil
import stat
import subprocess
import sys
import sysconfig
import zipfile

SOURCE = pathlib.Path(__file__).resolve().parents[3]
TARGET = "brume_python_package"


# pip hides the packages of the interpreter from what it builds; NumPy is one that CMake looks for, whenever it runs.
ENVIRONMENT = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONNOUSERSITE")}


def run(*command):
    try:
        subprocess.run([str(word) for word in command], check=True, env=ENVIRONMENT)
    except FileNotFoundError:
        raise SystemExit(f"{command[0]} is not there; it comes with Debian's package {command[0]}")
    except subprocess.CalledProcessError as error:
        raise SystemExit(f"{' '.join(map(str, command))}: ended with status {error.returncode}")


def built_package(settings):
    """The folder with the package and its metadata."""
    build = pathlib.Path(settings.get("build-dir") or SOURCE / "build/wheel").resolve()
    if not (build / "CMakeCache.txt").exists():
        generator = ["-G", "Ninja"] if shutil.which("ninja") else []
        run("cmake", "-S", SOURCE, "-B", build, *generator, "-DCMAKE_BUILD_TYPE=Release", "-DBRUME_TESTS=OFF",
            "-DBRUME_BENCH=OFF", f"-DPython3_EXECUTABLE={sys.executable}")
    if TARGET not in subprocess.run(["cmake", "--build", str(build), "--target", "help"], capture_output=True,
                                    text=True, env=ENVIRONMENT).stdout:
        raise SystemExit(f"no Python package in {build}: expected Debian's pybind11-dev, python3-dev and python3-numpy, "
                         f"and a {sys.executable} that has NumPy (python3 -m venv --system-site-packages)")
    run("cmake", "--build", build, "--target", TARGET, "--parallel", settings.get("jobs") or os.cpu_count() or 1)
    folder = build / "python_package"
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    if not (folder / "brume" / f"_brume{suffix}").exists():
        raise SystemExit(f"{folder} was built for another interpreter than {sys.executable}; remove {build}")
    return folder


def tag():
    version = f"cp{sys.version_info.major}{sys.version_info.minor}"
    return f"{version}-{version}-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"


def record_line(name, data):
    digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
    return f"{name},sha256={digest},{len(data)}\n"


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    folder = built_package(config_settings or {})
    info = next(folder.glob("brume-*.dist-info"))
    files = {}  # name in the wheel: contents, mode
    for path in sorted([*(folder / "brume").rglob("*"), *info.iterdir()]):
        if path.is_file() and "__pycache__" not in path.parts:
            files[path.relative_to(folder).as_posix()] = (path.read_bytes(), path.stat().st_mode)
    text = f"Wheel-Version: 1.0\nGenerator: brume\nRoot-Is-Purelib: false\nTag: {tag()}\n"
    files[f"{info.name}/WHEEL"] = (text.encode(), 0o644)
    files[f"{info.name}/LICENSE"] = ((SOURCE / "LICENSE").read_bytes(), 0o644)
    record = "".join(record_line(name, data) for name, (data, _) in files.items())
    files[f"{info.name}/RECORD"] = ((record + f"{info.name}/RECORD,,\n").encode(), 0o644)
    name = f"{info.name.removesuffix('.dist-info')}-{tag()}.whl"
    with zipfile.ZipFile(pathlib.Path(wheel_directory) / name, "w", zipfile.ZIP_DEFLATED) as wheel:
        for path, (data, mode) in files.items():
            entry = zipfile.ZipInfo(path)
            entry.external_attr = (stat.S_IFREG | (mode & 0o777)) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            wheel.writestr(entry, data)
    return name


def build_sdist(sdist_directory, config_settings=None):
    raise SystemExit("brume is built from a clone; there is no source archive for pip to make")
