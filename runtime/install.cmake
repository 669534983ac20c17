# `cmake --install`: the runtime with its header for find_package(nacre) and pkg-config, and the command line if it was built.
# `--component runtime` or `--component tools` for one of them.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
set(CMAKE_INSTALL_DEFAULT_COMPONENT_NAME runtime)

set_target_properties(nacre_runtime PROPERTIES EXPORT_NAME runtime)
set_target_properties(nacre_formats PROPERTIES EXPORT_NAME formats)
# formats and the flags are inside the runtime; they are exported because a static library names what it links
install(TARGETS nacre_runtime nacre_formats nacre_flags EXPORT nacre-targets)
install(DIRECTORY ${CMAKE_CURRENT_LIST_DIR}/include/nacre DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})

set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/nacre)
install(EXPORT nacre-targets NAMESPACE nacre:: DESTINATION ${package_dir})
configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/nacre-config.cmake.in ${PROJECT_BINARY_DIR}/nacre-config.cmake
  INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/nacre-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/nacre-config.cmake ${PROJECT_BINARY_DIR}/nacre-config-version.cmake DESTINATION ${package_dir})

get_target_property(runtime_type nacre_runtime TYPE)
if(runtime_type STREQUAL "STATIC_LIBRARY")
  set(NACRE_PC_STATIC_LIBS " -lnacre_formats -ltinygltf -lstdc++ -lm")
endif()
# relative to the .pc file, so that `cmake --install --prefix` and moved trees work
file(RELATIVE_PATH NACRE_PC_PREFIX /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
configure_file(${CMAKE_CURRENT_LIST_DIR}/nacre.pc.in ${PROJECT_BINARY_DIR}/nacre.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/nacre.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)

if(TARGET nacre)
  install(TARGETS nacre COMPONENT tools)
endif()
