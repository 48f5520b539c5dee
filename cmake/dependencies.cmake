# Every library brume uses, each with the Debian package that brings it. A missing one stops the configuration with the
# command that installs it.

function(brume_missing library package)
  message(FATAL_ERROR "brume needs ${library}, which was not found. Install it with: apt-get install ${package}")
endfunction()

macro(brume_package name package)
  find_package(${name} CONFIG QUIET)
  if(NOT ${name}_FOUND)
    brume_missing(${name} ${package})
  endif()
endmacro()

brume_package(TBB libtbb-dev)
brume_package(OpenEXR libopenexr-dev)
brume_package(glm libglm-dev)
brume_package(hwy libhwy-dev)
brume_package(Eigen3 libeigen3-dev)
brume_package(embree libembree-dev)
brume_package(toml11 libtoml11-dev)
brume_package(CLI11 libcli11-dev)
brume_package(fmt libfmt-dev)
brume_package(nlohmann_json nlohmann-json3-dev)
# The filter oidn runs the library where it is there, and brume's own evaluation of its networks elsewhere.
find_package(OpenImageDenoise 2 CONFIG QUIET)
if(OpenImageDenoise_FOUND)
  set(brume_optional_library OpenImageDenoise)
endif()
if(BRUME_TESTS)
  brume_package(GTest libgtest-dev)
endif()
if(BRUME_BENCH)
  brume_package(benchmark libbenchmark-dev)
endif()

find_path(STB_INCLUDE_DIR stb_image.h PATH_SUFFIXES stb)
if(NOT STB_INCLUDE_DIR)
  brume_missing(stb libstb-dev)
endif()

find_path(DEFLATE_INCLUDE_DIR libdeflate.h)
find_library(DEFLATE_LIBRARY deflate)
if(NOT DEFLATE_INCLUDE_DIR OR NOT DEFLATE_LIBRARY)
  brume_missing(libdeflate libdeflate-dev)
endif()

# Debian 12 puts its configuration for CMake where CMake does not look.
find_path(OPENCOLORIO_INCLUDE_DIR OpenColorIO/OpenColorIO.h)
find_library(OPENCOLORIO_LIBRARY OpenColorIO)
if(NOT OPENCOLORIO_INCLUDE_DIR OR NOT OPENCOLORIO_LIBRARY)
  brume_missing(OpenColorIO libopencolorio-dev)
endif()

# Debian's FindOpenVDB pulls in every optional component; the loader needs the library and its headers only.
find_path(OPENVDB_INCLUDE_DIR openvdb/openvdb.h)
find_library(OPENVDB_LIBRARY openvdb)
# OpenVDB's headers include Boost's, which its Debian package does not bring; the filters take Student's quantiles from
# Boost.Math.
find_path(BOOST_INCLUDE_DIR boost/math/distributions/students_t.hpp)
if(NOT BOOST_INCLUDE_DIR)
  brume_missing(Boost libboost-dev)
endif()
if(NOT OPENVDB_INCLUDE_DIR OR NOT OPENVDB_LIBRARY)
  brume_missing(OpenVDB "libopenvdb-dev libboost-dev libblosc-dev")
endif()
# NanoVDB is headers alone, which unpack what its files are compressed with.
find_path(NANOVDB_INCLUDE_DIR nanovdb/util/NanoToOpenVDB.h)
find_library(BLOSC_LIBRARY blosc)
find_package(ZLIB)
if(NOT NANOVDB_INCLUDE_DIR OR NOT BLOSC_LIBRARY OR NOT ZLIB_FOUND)
  brume_missing(NanoVDB "libnanovdb-dev libblosc-dev zlib1g-dev")
endif()
add_library(brume_openvdb INTERFACE)
target_include_directories(brume_openvdb SYSTEM INTERFACE ${OPENVDB_INCLUDE_DIR})
# Its headers convert half floats with Imath, which OpenEXR brings.
target_link_libraries(brume_openvdb INTERFACE ${OPENVDB_LIBRARY} TBB::tbb Imath::Imath ${BLOSC_LIBRARY} ZLIB::ZLIB)
