# NACRE_CAN_LINK_SINGLE_OBJECT, and nacre_single_object(OUTPUT PATTERN TARGET...): links the objects of object libraries into one
# relocatable object in which only symbols that match PATTERN stay global.
#
# Templates and inline functions lie in section groups that the final link merges by name, local or not; --force-group-allocation
# dissolves the groups. Objects for link-time optimisation have no symbols yet, hence -fno-lto.
set(NACRE_CAN_LINK_SINGLE_OBJECT OFF)
if(UNIX AND NOT APPLE AND CMAKE_LINKER AND CMAKE_OBJCOPY)
  execute_process(COMMAND ${CMAKE_LINKER} --help OUTPUT_VARIABLE linker_help ERROR_QUIET)
  if(linker_help MATCHES "--force-group-allocation")
    set(NACRE_CAN_LINK_SINGLE_OBJECT ON)
  else()
    message(STATUS "${CMAKE_LINKER} lacks --force-group-allocation: the static runtime shows inline functions of GLM and JSON to the linker")
  endif()
endif()

function(nacre_single_object output pattern)
  set(objects "")
  foreach(target ${ARGN})
    list(APPEND objects $<TARGET_OBJECTS:${target}>)
    target_compile_options(${target} PRIVATE -fno-lto)
  endforeach()
  add_custom_command(OUTPUT ${output}
    COMMAND ${CMAKE_LINKER} -r --force-group-allocation -o ${output} ${objects}
    COMMAND ${CMAKE_OBJCOPY} --wildcard --keep-global-symbol=${pattern} ${output}
    DEPENDS ${objects} COMMAND_EXPAND_LISTS VERBATIM)
endfunction()
