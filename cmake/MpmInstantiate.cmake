# mpm_instantiate(<backend> <out>): one unit per model of src/kernels/models.cmake, written from
# src/kernels/instantiate_<backend>.{cpp,cu}.in with @MODEL@ (TaitFluid) and @MODEL_HEADER@ (tait_fluid).
# One source per model, not per kernel: the latter doubles the compile time.
include("${PROJECT_SOURCE_DIR}/src/kernels/models.cmake")
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${PROJECT_SOURCE_DIR}/src/kernels/models.cmake")

function(mpm_instantiate backend out)
  file(GLOB templates CONFIGURE_DEPENDS "${PROJECT_SOURCE_DIR}/src/kernels/instantiate_${backend}*.in")
  set(units)
  set(headers)
  foreach(template IN LISTS templates)
    cmake_path(GET template STEM LAST_ONLY stem_and_suffix) # instantiate_cpu.cpp
    cmake_path(GET stem_and_suffix STEM stem)
    cmake_path(GET stem_and_suffix EXTENSION suffix)
    foreach(MODEL IN LISTS MPM_MODELS)
      string(REGEX REPLACE "([a-z0-9])([A-Z])" "\\1_\\2" MODEL_HEADER "${MODEL}")
      string(TOLOWER "${MODEL_HEADER}" MODEL_HEADER)
      if(NOT EXISTS "${PROJECT_SOURCE_DIR}/include/mpm/physics/material/${MODEL_HEADER}.hpp")
        message(FATAL_ERROR "models.cmake lists ${MODEL}, but there is no physics/material/${MODEL_HEADER}.hpp")
      endif()
      set(unit "${PROJECT_BINARY_DIR}/generated/${stem}_${MODEL_HEADER}${suffix}")
      configure_file("${template}" "${unit}" @ONLY)
      list(APPEND units "${unit}")
      list(APPEND headers "#include \"mpm/physics/material/${MODEL_HEADER}.hpp\"")
    endforeach()
  endforeach()
  list(REMOVE_DUPLICATES headers)
  list(JOIN headers "\n" headers)
  file(CONFIGURE OUTPUT "${PROJECT_BINARY_DIR}/generated/mpm/kernels/model_headers.inc" CONTENT "${headers}\n" @ONLY)
  # The list itself, for the registry: one MPM_MODEL(Name) a line.
  list(TRANSFORM MPM_MODELS REPLACE "(.+)" "MPM_MODEL(\\1)" OUTPUT_VARIABLE lines)
  list(JOIN lines "\n" lines)
  file(CONFIGURE OUTPUT "${PROJECT_BINARY_DIR}/generated/mpm/kernels/models.inc" CONTENT "${lines}\n" @ONLY)
  target_include_directories(mpm_flags INTERFACE
    "$<BUILD_INTERFACE:${PROJECT_BINARY_DIR}/generated>")
  set(${out} ${units} PARENT_SCOPE)
endfunction()
