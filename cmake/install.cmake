# What `cmake --install` puts where: programs, library, Python package, manual page, completions, Debian package.

include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

# One static archive of all rooms. Static, because its C++ interface promises no binary compatibility from version to
# version, and filters put themselves on the list: a program links the whole archive.
add_library(brume_archive STATIC $<TARGET_OBJECTS:brume_base> $<TARGET_OBJECTS:brume_image> $<TARGET_OBJECTS:brume_volume>
  $<TARGET_OBJECTS:brume_files> $<TARGET_OBJECTS:brume_scene> $<TARGET_OBJECTS:brume_world> $<TARGET_OBJECTS:brume_transport>
  $<TARGET_OBJECTS:brume_guides> $<TARGET_OBJECTS:brume_film> $<TARGET_OBJECTS:brume_session> $<TARGET_OBJECTS:brume_filters> $<TARGET_OBJECTS:brume_evaluate>
  $<TARGET_OBJECTS:brume_workflows>)
set_target_properties(brume_archive PROPERTIES OUTPUT_NAME brume LINKER_LANGUAGE CXX)

# The program describes itself.
set(described ${PROJECT_BINARY_DIR}/described)
set(pages)
foreach(page man bash zsh fish)
  add_custom_command(OUTPUT ${described}/${page}
    COMMAND ${CMAKE_COMMAND} -E make_directory ${described}
    COMMAND brume docs ${page} > ${described}/${page}
    DEPENDS brume VERBATIM)
  list(APPEND pages ${described}/${page})
endforeach()
add_custom_target(brume_described DEPENDS ${pages})

# Everything that is installed, and nothing else: what ./run install builds.
add_custom_target(brume_install_parts ALL DEPENDS brume brume-vdb-reader brume_archive brume_described)

install(TARGETS brume brume-vdb-reader RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
install(FILES $<TARGET_FILE:brume_archive> DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(DIRECTORY include/brume DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
# What knows OpenEXR's headers is no part of the interface.
install(DIRECTORY base volume image render filters evaluate workflows DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/brume
  FILES_MATCHING PATTERN "*.h" PATTERN exr_common.h EXCLUDE PATTERN exr_zip.h EXCLUDE)
install(FILES ${described}/man DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 RENAME brume.1)
install(FILES ${described}/bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME brume)
install(FILES ${described}/zsh DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions RENAME _brume)
install(FILES ${described}/fish DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d RENAME brume.fish)
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/brume RENAME copyright)

set(config_dir ${CMAKE_INSTALL_LIBDIR}/cmake/brume)
configure_package_config_file(cmake/brumeConfig.cmake.in ${PROJECT_BINARY_DIR}/brumeConfig.cmake INSTALL_DESTINATION ${config_dir}
  PATH_VARS CMAKE_INSTALL_INCLUDEDIR CMAKE_INSTALL_LIBDIR)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/brumeConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/brumeConfig.cmake ${PROJECT_BINARY_DIR}/brumeConfigVersion.cmake DESTINATION ${config_dir})

if(TARGET brume_python)
  add_dependencies(brume_install_parts brume_python_package)
  install(DIRECTORY ${PROJECT_BINARY_DIR}/python_package/ DESTINATION lib/python3/dist-packages USE_SOURCE_PERMISSIONS
    PATTERN __pycache__ EXCLUDE)
endif()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME brume)
set(CPACK_PACKAGE_VENDOR brume)
set(CPACK_PACKAGE_CONTACT "the brume project <brume@example.invalid>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "renders OpenVDB smoke and clouds, and removes Monte Carlo noise from them")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS python3-numpy)
# For those who build against the library.
set(CPACK_DEBIAN_PACKAGE_SUGGESTS "libtbb-dev, libopenexr-dev, libopencolorio-dev, libglm-dev, libfmt-dev, libhwy-dev, libdeflate-dev, libembree-dev, nlohmann-json3-dev")
include(CPack)
