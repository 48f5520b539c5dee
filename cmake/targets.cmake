# One static library per folder, built with warnings as errors.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_CXX_FLAGS_RELEASE "-O3")
# The Python module is a shared library made of the static ones. With hidden symbols, which nothing can replace when the
# module is loaded, code that may lie anywhere runs as fast as other code (docs/python.md).
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_CXX_VISIBILITY_PRESET hidden)
set(CMAKE_VISIBILITY_INLINES_HIDDEN ON)

add_library(brume_options INTERFACE)
target_include_directories(brume_options INTERFACE ${PROJECT_SOURCE_DIR})
target_compile_options(brume_options INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion
  # GCC 12 sees overlapping copies in its own std::string. Clang, which builds the fuzzers, and a GCC that nobody has tried
  # here warn of other things, which stop no user.
  $<$<AND:$<CXX_COMPILER_ID:GNU>,$<VERSION_LESS:$<CXX_COMPILER_VERSION>,15>>:-Werror>
  $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
  # Errors of math functions are read from their results, never from errno; NaN and infinity keep their meaning.
  -fno-math-errno
  # The same bits on every machine of one build: no contraction behind the code's back.
  -ffp-contract=off)
# GCC collects its garbage whenever its heap has doubled from 128 MB on, which precompiled headers alone fill; that took a
# tenth of the time of a build. Most files take 40 MB more without it, the largest 1.2 GB in all.
target_compile_options(brume_options INTERFACE $<$<CXX_COMPILER_ID:GNU>:--param=ggc-min-heapsize=1048576>)
# GCC 14 takes a precompiled header only where these are as they were when it was made, and chooses them by -O1 or -O3. A
# compiler that refuses it for another reason reads the headers themselves, which takes longer.
set(CMAKE_PCH_WARN_INVALID OFF)
if(CMAKE_CXX_COMPILER_ID STREQUAL GNU AND CMAKE_CXX_COMPILER_VERSION VERSION_GREATER_EQUAL 13
   AND CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  target_compile_options(brume_options INTERFACE -mvzeroupper -munroll-only-small-loops)
endif()
if(BRUME_SANITIZE)
  # GCC takes the standard library's moved-from functions for uninitialised when it instruments them.
  target_compile_options(brume_options INTERFACE -fsanitize=${BRUME_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=undefined
    $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
  target_link_options(brume_options INTERFACE -fsanitize=${BRUME_SANITIZE})
endif()

# The headers that nearly every file of a target reads are read once: a third of the time that compiling takes. Not with
# sanitizers, so that one build is left in which a header that includes too little is noticed, and in which GCC 12 warns
# of bounds: in a precompiled std::string it sees copies beyond them.
function(brume_precompile target)
  if(NOT BRUME_SANITIZE)
    target_precompile_headers(${target} ${ARGN})
    target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:GNU>:-Wno-array-bounds$<SEMICOLON>-Wno-stringop-overflow$<SEMICOLON>-Wno-stringop-overread>)
  endif()
endfunction()

include(${CMAKE_CURRENT_LIST_DIR}/simd.cmake)

# Files that parse, call, write reports: at -O1 they take half as long to compile as at -O3, and nobody waits for what
# they do. Whatever runs for each voxel, pixel or path stays at -O3.
function(brume_front_sources)
  set_property(SOURCE ${ARGN} APPEND PROPERTY COMPILE_OPTIONS -O1)
endfunction()

# FRONT: all of its files are such.
function(brume_library name)
  cmake_parse_arguments(ARG "OBJECT;FRONT" "" "SOURCES;LINK;PRIVATE_LINK" ${ARGN})
  if(ARG_OBJECT)
    add_library(brume_${name} OBJECT ${ARG_SOURCES})
  else()
    add_library(brume_${name} STATIC ${ARG_SOURCES})
  endif()
  target_link_libraries(brume_${name} PUBLIC ${ARG_LINK} PRIVATE brume_options ${ARG_PRIVATE_LINK})
  target_include_directories(brume_${name} PUBLIC ${PROJECT_SOURCE_DIR})
  brume_simd_sources(${ARG_SOURCES})
  if(ARG_FRONT)
    target_compile_options(brume_${name} PRIVATE -O1)
  endif()
  if(NOT name MATCHES "^(base|vdb)$")
    brume_precompile(brume_${name} REUSE_FROM brume_base)
  endif()
endfunction()
