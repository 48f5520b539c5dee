# Packs the Debian package, unpacks it and runs the program from it.
# cmake -DBUILD= -DSOURCE= -DWORK= -DCPACK= -P deb_test.cmake

include(${CMAKE_CURRENT_LIST_DIR}/run.cmake)

find_program(SHLIBDEPS dpkg-shlibdeps)
find_program(DPKG_DEB dpkg-deb)
if(NOT SHLIBDEPS OR NOT DPKG_DEB)
  message("no Debian package: it needs dpkg-dev")
  return()
endif()

file(REMOVE_RECURSE ${WORK})
run(pack ${CPACK} -G DEB --config ${BUILD}/CPackConfig.cmake -B ${WORK})
file(GLOB package ${WORK}/brume_*.deb)
run(control ${DPKG_DEB} -f ${package} Depends)
foreach(library libopenvdb libopenexr libembree libtbb)
  if(NOT output MATCHES "${library}")
    message(FATAL_ERROR "the package does not depend on ${library}: ${output}")
  endif()
endforeach()
run(unpack ${DPKG_DEB} -x ${package} ${WORK}/root)
run(render ${CMAKE_COMMAND} -E env PATH=/usr/bin:/bin ${WORK}/root/usr/bin/brume render ${SOURCE}/data/scenes/cloud.toml
  -o ${WORK}/cloud.exr --spp 1 -D film.width=8 -D film.height=8 -q)
file(REMOVE_RECURSE ${WORK})
