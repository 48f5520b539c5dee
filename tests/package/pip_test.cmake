# Installs the Python package by pip from the clone, offline, into an environment of its own, and uses it there. What CMake
# has built already is packed; a clone's own first build takes as long as the program's.
# cmake -DBUILD= -DSOURCE= -DWORK= -DPYTHON= -P pip_test.cmake

include(${CMAKE_CURRENT_LIST_DIR}/run.cmake)

execute_process(COMMAND ${PYTHON} -c "import pip, ensurepip, venv" RESULT_VARIABLE missing OUTPUT_QUIET ERROR_QUIET)
if(missing)
  message("skipped: Debian's python3-pip and python3-venv are not there")
  return()
endif()

file(REMOVE_RECURSE ${WORK})
run(venv ${PYTHON} -m venv --system-site-packages ${WORK}/env)
set(python ${WORK}/env/bin/python)
set(ENV{PIP_NO_INDEX} 1)  # nothing may be fetched
set(ENV{PIP_DISABLE_PIP_VERSION_CHECK} 1)
unset(ENV{PYTHONPATH})
unset(ENV{BRUME_VDB_READER})
set(ENV{PATH} "$ENV{PATH}:/usr/bin:/bin")
run(install ${python} -m pip install --config-settings build-dir=${BUILD} ${SOURCE})
run(use ${CMAKE_COMMAND} -E chdir ${WORK} ${python} -c "
import pathlib, brume, importlib.metadata as metadata
package = pathlib.Path(brume.__file__).parent
assert pathlib.Path('${WORK}/env').resolve() in package.resolve().parents, package
assert metadata.version('brume') == brume.__version__
assert metadata.requires('brume') == ['numpy'], metadata.requires('brume')
assert {'py.typed', '__init__.pyi'} <= {file.name for file in package.iterdir()}
print(brume.render('${SOURCE}/data/scenes/cloud.toml', spp=1, film__width=8, film__height=8))")
# Of what the system's packages miss of one another it tells, too.
run(check ${python} -c "
import subprocess, sys
told = subprocess.run([sys.executable, '-m', 'pip', 'check'], capture_output=True, text=True).stdout
assert not any(line.startswith('brume ') for line in told.splitlines()), told")
run(uninstall ${python} -m pip uninstall -y brume)
file(GLOB left ${WORK}/env/lib/python3*/site-packages/brume*)
if(left)
  message(FATAL_ERROR "pip uninstall leaves ${left}")
endif()
file(REMOVE_RECURSE ${WORK})
