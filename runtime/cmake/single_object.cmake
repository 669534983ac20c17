# NACRE_CAN_LINK_SINGLE_OBJECT, and nacre_single_object(OUTPUT PATTERN TARGET...): links the objects of object libraries into one
# relocatable object in which only symbols that match PATTERN stay global.
#
# Templates and inline functions lie in section groups that the final link merges by name, local or not; --force-group-allocation
# dissolves the groups. Objects for link-time optimisation have no symbols yet, hence -fno-lto.
set(NACRE_CAN_LINK_SINGLE_OBJECT OFF)
if(UNIX AND NOT APPLE AND CMAKE_OBJCOPY)
  set(linkers ${CMAKE_LINKER})
  if(NOT CMAKE_CROSSCOMPILING) # that of LLVM has learnt it late
    find_program(NACRE_BFD_LINKER ld.bfd)
    list(APPEND linkers ${NACRE_BFD_LINKER})
  endif()
  foreach(linker ${linkers})
    execute_process(COMMAND ${linker} --help OUTPUT_VARIABLE linker_help ERROR_QUIET)
    if(linker_help MATCHES "--force-group-allocation")
      set(NACRE_CAN_LINK_SINGLE_OBJECT ON)
      set(NACRE_OBJECT_LINKER ${linker})
      break()
    endif()
  endforeach()
  if(NOT NACRE_CAN_LINK_SINGLE_OBJECT)
    message(STATUS "no linker knows --force-group-allocation (GNU ld does): the static runtime shows inline functions of GLM and JSON")
  endif()
endif()

function(nacre_single_object output pattern)
  set(objects "")
  foreach(target ${ARGN})
    list(APPEND objects $<TARGET_OBJECTS:${target}>)
    target_compile_options(${target} PRIVATE -fno-lto)
  endforeach()
  add_custom_command(OUTPUT ${output}
    COMMAND ${NACRE_OBJECT_LINKER} -r --force-group-allocation -o ${output} ${objects}
    COMMAND ${CMAKE_OBJCOPY} --wildcard --keep-global-symbol=${pattern} ${output}
    DEPENDS ${objects} COMMAND_EXPAND_LISTS VERBATIM)
endfunction()
