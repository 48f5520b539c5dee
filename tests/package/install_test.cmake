# Installs a build into a folder of its own, moves that away, and uses it as somebody else would.
# cmake -DBUILD= -DSOURCE= -DWORK= -DCXX= -DGENERATOR= [-DPYTHON=] -P install_test.cmake

include(${CMAKE_CURRENT_LIST_DIR}/run.cmake)

function(expect_text file text)
  file(READ ${file} content)
  string(FIND "${content}" "${text}" at)
  if(at EQUAL -1)
    message(FATAL_ERROR "${file} has no '${text}'")
  endif()
endfunction()

file(REMOVE_RECURSE ${WORK})
run(install ${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/first)
# Nothing in it may know where it was installed.
file(RENAME ${WORK}/first ${WORK}/prefix)
set(prefix ${WORK}/prefix)
set(ENV{PATH} "${prefix}/bin:$ENV{PATH}")
unset(ENV{BRUME_VDB_READER})

run(configure ${CMAKE_COMMAND} -S ${SOURCE}/tests/package -B ${WORK}/foreign -G ${GENERATOR} -DCMAKE_PREFIX_PATH=${prefix}
  -DCMAKE_CXX_COMPILER=${CXX} -DCMAKE_BUILD_TYPE=Release)
run(build ${CMAKE_COMMAND} --build ${WORK}/foreign)
run(foreign ${WORK}/foreign/foreign ${SOURCE}/data/scenes/cloud.toml ${WORK}/clean.exr)

run(render ${prefix}/bin/brume render ${SOURCE}/data/scenes/cloud.toml -o ${WORK}/cloud.exr --spp 1 -D film.width=8 -D film.height=8 -q)
foreach(verb render denoise compare filters docs)
  expect_text(${prefix}/share/man/man1/brume.1 ".SS brume ${verb}")
  expect_text(${prefix}/share/bash-completion/completions/brume "      ${verb}) words=")
  expect_text(${prefix}/share/zsh/vendor-completions/_brume "    ${verb})")
  expect_text(${prefix}/share/fish/vendor_completions.d/brume.fish "-f -a ${verb} ")
endforeach()
run(bash bash -c "source '${prefix}/share/bash-completion/completions/brume'
  COMP_WORDS=(brume denoise --noise sp) COMP_CWORD=3
  _brume
  test \"\${COMPREPLY[*]}\" = spatial")

if(PYTHON)
  set(ENV{PYTHONPATH} ${prefix}/lib/python3/dist-packages)
  set(ENV{PATH} /usr/bin:/bin)
  run(python ${PYTHON} -c "import brume; print(brume.render('${SOURCE}/data/scenes/cloud.toml', spp=1, film__width=8))")
endif()
file(REMOVE_RECURSE ${WORK})
