# brume_embed(target file...): texts that stand in files of their own become constants of `target`: of run.sh
#   inline constexpr std::string_view run_sh
# in the header "run_sh.h", in the namespace brume::embedded.
function(brume_embed target)
  set(folder ${CMAKE_CURRENT_BINARY_DIR}/embedded)
  foreach(file ${ARGN})
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${file})
    file(READ ${file} text)
    string(MAKE_C_IDENTIFIER ${file} name)
    file(CONFIGURE OUTPUT ${folder}/${name}.h @ONLY CONTENT "#pragma once
#include <string_view>

namespace brume::embedded {
inline constexpr std::string_view @name@ = R\"TEXT(@text@)TEXT\";
}
")
  endforeach()
  target_include_directories(${target} PRIVATE ${folder})
endfunction()
