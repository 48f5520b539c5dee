# The kernels' instruction sets. Highway compiles a file that includes hwy/foreach_target.h once for each, and the program
# chooses when it runs; the bits of what it computes are the same with all of them.
#
# all     for programs that other machines run, and for tests, which compare them: everything but SSSE3, whose machines
#         of 2006 take the scalar code
# native  what every processor has, and the best that this one has: half the time that those files take to compile
set(BRUME_SIMD all CACHE STRING "instruction sets of the kernels: all, or native for this machine's alone")
set_property(CACHE BRUME_SIMD PROPERTY STRINGS all native)
set(brume_simd_disabled HWY_SSSE3)
if(BRUME_SIMD STREQUAL native)
  if(NOT DEFINED BRUME_SIMD_NATIVE AND NOT CMAKE_CROSSCOMPILING)
    try_run(ran compiled ${PROJECT_BINARY_DIR}/simd_targets ${CMAKE_CURRENT_LIST_DIR}/simd_targets.cpp
      LINK_LIBRARIES hwy::hwy RUN_OUTPUT_VARIABLE targets)
    if(compiled AND ran EQUAL 0)
      set(BRUME_SIMD_NATIVE "${targets}" CACHE INTERNAL "instruction sets of a build for this machine")
    endif()
  endif()
  if(BRUME_SIMD_NATIVE)
    set(brume_simd_disabled "~(${BRUME_SIMD_NATIVE})")
  endif()
elseif(NOT BRUME_SIMD STREQUAL all)
  message(FATAL_ERROR "BRUME_SIMD is '${BRUME_SIMD}'; expected all or native")
endif()

# The definition is these files' own, so that going from one to the other compiles nothing else again.
function(brume_simd_sources)
  foreach(source ${ARGN})
    get_filename_component(path ${source} ABSOLUTE)
    set(found "")
    if(EXISTS ${path})
      file(STRINGS ${path} found REGEX "hwy/foreach_target\\.h")
    endif()
    if(found)
      set_property(SOURCE ${source} APPEND PROPERTY COMPILE_DEFINITIONS "HWY_DISABLED_TARGETS=${brume_simd_disabled}")
    endif()
  endforeach()
endfunction()
