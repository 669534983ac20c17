# `cmake --install`: the runtime with its header for find_package(nacre) and pkg-config (component runtime).
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
set(CMAKE_INSTALL_DEFAULT_COMPONENT_NAME runtime)

set_target_properties(nacre_runtime PROPERTIES EXPORT_NAME runtime)
install(TARGETS nacre_runtime EXPORT nacre-targets)
install(DIRECTORY ${CMAKE_CURRENT_LIST_DIR}/include/nacre DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})

set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/nacre)
install(EXPORT nacre-targets NAMESPACE nacre:: DESTINATION ${package_dir})
configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/nacre-config.cmake.in ${PROJECT_BINARY_DIR}/nacre-config.cmake
  INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/nacre-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/nacre-config.cmake ${PROJECT_BINARY_DIR}/nacre-config-version.cmake DESTINATION ${package_dir})

if(BUILD_SHARED_LIBS)
  set(NACRE_PC_CFLAGS " -DNACRE_SHARED")
else()
  list(TRANSFORM NACRE_CXX_LIBRARIES PREPEND " -l" OUTPUT_VARIABLE NACRE_PC_STATIC_LIBS)
  list(JOIN NACRE_PC_STATIC_LIBS "" NACRE_PC_STATIC_LIBS)
endif()
# relative to the .pc file, so that `cmake --install --prefix` and moved trees work
file(RELATIVE_PATH NACRE_PC_PREFIX /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
configure_file(${CMAKE_CURRENT_LIST_DIR}/nacre.pc.in ${PROJECT_BINARY_DIR}/nacre.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/nacre.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
