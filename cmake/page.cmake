# The pages of `brume evaluate` and `brume view`: their front ends in apps/page/ are bundled by Node and embedded in the
# program, which then needs no Node. Included where the program's part that embeds the first is built. Sets BRUME_PAGE and
# BRUME_VIEW_SOURCE, for all folders, and BRUME_PAGE_SOURCE.

set(BRUME_PAGE OFF CACHE INTERNAL "whether the page is built in")
set(BRUME_PAGE_SOURCE ${PROJECT_SOURCE_DIR}/evaluate/report/page_absent.cpp)
set(BRUME_VIEW_SOURCE ${PROJECT_SOURCE_DIR}/apps/view/view_absent.cpp CACHE INTERNAL "the page of brume view as C++")
set(page_folder ${PROJECT_SOURCE_DIR}/apps/page)

function(brume_no_page why)
  message(STATUS "${why}: `brume evaluate` will write no page (index.html), `brume view` has none; all else is built")
endfunction()

find_program(NODE_PROGRAM NAMES node nodejs)
find_program(NPM_PROGRAM npm)
if(NOT NODE_PROGRAM OR NOT NPM_PROGRAM)
  brume_no_page("Node.js and npm (nodejs npm) are not there")
  return()
endif()
execute_process(COMMAND ${NODE_PROGRAM} --version OUTPUT_VARIABLE node_version OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
string(REGEX REPLACE "^v" "" node_version "${node_version}")
if(node_version VERSION_LESS 18)
  brume_no_page("Node.js is of version '${node_version}', older than 18")
  return()
endif()

# npm's own record of what it installed is newer than the list it installed from.
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${page_folder}/package-lock.json)
set(installed ${page_folder}/node_modules/.package-lock.json)
if(NOT EXISTS ${installed} OR ${page_folder}/package-lock.json IS_NEWER_THAN ${installed})
  message(STATUS "Installing the page's npm packages into apps/page/node_modules")
  execute_process(COMMAND ${NPM_PROGRAM} ci --ignore-scripts --no-audit --no-fund --prefer-offline --fetch-retries=1
    --fetch-retry-mintimeout=2000 WORKING_DIRECTORY ${page_folder}
    RESULT_VARIABLE failed OUTPUT_VARIABLE log ERROR_VARIABLE log TIMEOUT 300)
  if(failed)
    # What a broken installation leaves would look whole to the next configuration.
    file(REMOVE_RECURSE ${page_folder}/node_modules)
    message(STATUS "${log}")
    brume_no_page("npm could not install the page's packages (offline?)")
    return()
  endif()
  file(TOUCH ${installed})
endif()

set(BRUME_PAGE ON CACHE INTERNAL "whether the page is built in")
set(bundles ${PROJECT_BINARY_DIR}/page)
set(BRUME_PAGE_SOURCE ${bundles}/page_bundle.cpp)
set(BRUME_VIEW_SOURCE ${bundles}/view_bundle.cpp CACHE INTERNAL "the page of brume view as C++")
file(GLOB page_sources CONFIGURE_DEPENDS ${page_folder}/src/* ${page_folder}/src/view/*)
file(MAKE_DIRECTORY ${bundles})
add_custom_command(OUTPUT ${BRUME_PAGE_SOURCE} ${BRUME_VIEW_SOURCE} ${bundles}/page.js ${bundles}/page.css ${bundles}/view.js
    ${bundles}/view.css
  COMMAND ${NODE_PROGRAM} ${page_folder}/build.mjs ${bundles}
  DEPENDS ${page_sources} ${page_folder}/build.mjs ${page_folder}/package-lock.json COMMENT "Bundling the pages" VERBATIM)
# Another folder's target embeds the second page: the files are made by one target, which both build first.
add_custom_target(brume_page_bundles DEPENDS ${BRUME_PAGE_SOURCE} ${BRUME_VIEW_SOURCE})
