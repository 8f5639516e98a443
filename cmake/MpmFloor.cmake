# Libraries and modules are made of whole folders, so that a new unit needs no CMake edit. They are
# declared in subdirectories because scikit-build-core empties the top CMakeFiles folder, objects
# included, in a new isolated build.

# Every unit waits for the include check: an upward include fails the build before anything
# compiles.
file(GLOB_RECURSE _mpm_texts CONFIGURE_DEPENDS
  "${PROJECT_SOURCE_DIR}/include/mpm/*" "${PROJECT_SOURCE_DIR}/src/*"
  "${PROJECT_SOURCE_DIR}/python/bindings/*")
set(_mpm_stamp "${PROJECT_BINARY_DIR}/floors.stamp")
add_custom_command(
  OUTPUT "${_mpm_stamp}"
  COMMAND "${Python_EXECUTABLE}" "${PROJECT_SOURCE_DIR}/tools/check_floors.py"
          "${PROJECT_SOURCE_DIR}"
  COMMAND "${CMAKE_COMMAND}" -E touch "${_mpm_stamp}"
  DEPENDS ${_mpm_texts} "${PROJECT_SOURCE_DIR}/tools/check_floors.py"
  COMMENT "Checking that no floor includes a higher one"
  VERBATIM)
add_custom_target(mpm_floors DEPENDS "${_mpm_stamp}")

# mpm_library(<name> FOLDERS <under src/>... [MODELS <backend>] [LINKS <target>...]) The .cpp and
# .cu units lying directly in these folders; with MODELS also the generated ones of a backend.
function(mpm_library name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "MODELS" "FOLDERS;LINKS")
  set(sources)
  foreach(folder IN LISTS arg_FOLDERS)
    file(GLOB found CONFIGURE_DEPENDS
      "${PROJECT_SOURCE_DIR}/src/${folder}/*.cpp" "${PROJECT_SOURCE_DIR}/src/${folder}/*.cu")
    list(APPEND sources ${found})
  endforeach()
  foreach(domain IN LISTS MPM_LEFT_OUT_DOMAINS)
    list(FILTER sources EXCLUDE REGEX "/solver/cpu/${domain}\\.cpp$")
  endforeach()
  if(arg_MODELS)
    mpm_instantiate(${arg_MODELS} generated)
    list(APPEND sources ${generated})
  endif()
  if(sources)
    add_library(${name} STATIC ${sources})
    set(hot ${sources})
    list(FILTER hot INCLUDE REGEX "/kernels/cpu/|/instantiate_cpu|/grid_passes\\.cpp$")
    set_source_files_properties(${hot} PROPERTIES
      COMPILE_OPTIONS "$<$<CONFIG:Release>:-O3>;${MPM_HOT_SANITIZED}")
    target_link_libraries(${name} PUBLIC mpm_flags ${arg_LINKS})
    add_dependencies(${name} mpm_floors)
  else() # headers only
    add_library(${name} INTERFACE)
    target_link_libraries(${name} INTERFACE mpm_flags ${arg_LINKS})
  endif()
endfunction()

# mpm_together(<library> <folder under src/> [<name> <regex>]) Where all is compiled anyway
# (LIBMPM_TOGETHER), units of the folder, or those that the expression names, are compiled as one:
# what they share is read and instantiated once. Units with options of their own stay alone.
function(mpm_together library folder)
  if(NOT LIBMPM_TOGETHER)
    return()
  endif()
  set(name "${folder}")
  set(which ".")
  if(ARGC GREATER 2)
    set(name "${folder}_${ARGV2}")
    set(which "${ARGV3}")
  endif()
  string(REPLACE "/" "_" name "${name}")
  get_target_property(sources ${library} SOURCES)
  list(FILTER sources INCLUDE REGEX "/src/${folder}/[^/]*[.]cpp$")
  list(FILTER sources INCLUDE REGEX "${which}")
  if(NOT sources) # LIBMPM_DOMAINS
    return()
  endif()
  set_source_files_properties(${sources} PROPERTIES UNITY_GROUP "${name}")
  set_target_properties(${library} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
endfunction()

# mpm_module(<name> SOURCE <under python/bindings/> LINKS <target>...)
function(mpm_module name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "SOURCE" "LINKS")
  set(source "${PROJECT_SOURCE_DIR}/python/bindings/${arg_SOURCE}")
  pybind11_add_module(${name} MODULE NO_EXTRAS "${source}")
  target_link_libraries(${name} PRIVATE ${arg_LINKS} mpm_flags)
  # What is written in Python's terms is not where time goes, and long to optimise.
  target_compile_options(${name} PRIVATE $<$<CONFIG:Release>:-O1>)
  add_dependencies(${name} mpm_floors)
  install(TARGETS ${name} LIBRARY DESTINATION libmpm COMPONENT python)
  if(LIBMPM_INPLACE)
    set_target_properties(${name} PROPERTIES
      LIBRARY_OUTPUT_DIRECTORY "${PROJECT_SOURCE_DIR}/python/libmpm")
  endif()
endfunction()
