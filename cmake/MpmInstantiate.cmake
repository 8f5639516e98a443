# What is generated from the list of models in src/kernels/models.cmake.
include("${PROJECT_SOURCE_DIR}/src/kernels/models.cmake")
foreach(model IN LISTS LIBMPM_MODELS)
  if(NOT model IN_LIST MPM_MODELS)
    list(JOIN MPM_MODELS ", " known)
    message(FATAL_ERROR "LIBMPM_MODELS names ${model}; there are ${known}")
  endif()
endforeach()
if(LIBMPM_MODELS)
  set(MPM_MODELS ${LIBMPM_MODELS})
endif()

function(mpm_model_header model out) # TaitFluid -> tait_fluid
  string(REGEX REPLACE "([a-z0-9])([A-Z])" "\\1_\\2" name "${model}")
  string(TOLOWER "${name}" name)
  if(NOT EXISTS "${PROJECT_SOURCE_DIR}/include/mpm/physics/material/${name}.hpp")
    message(FATAL_ERROR "models.cmake lists ${model}, but there is no physics/material/${name}.hpp")
  endif()
  set(${out} "${name}" PARENT_SCOPE)
endfunction()

# For the registry: mpm/kernels/model_headers.inc includes every model's header, and
# mpm/kernels/models.inc says MPM_MODEL(Name) for each.
set(_mpm_generated "${PROJECT_BINARY_DIR}/generated")
set(_mpm_headers "")
set(_mpm_names "")
foreach(model IN LISTS MPM_MODELS)
  mpm_model_header(${model} header)
  string(APPEND _mpm_headers "#include \"mpm/physics/material/${header}.hpp\"\n")
  string(APPEND _mpm_names "MPM_MODEL(${model})\n")
endforeach()
file(CONFIGURE OUTPUT "${_mpm_generated}/mpm/kernels/model_headers.inc" CONTENT "${_mpm_headers}")
file(CONFIGURE OUTPUT "${_mpm_generated}/mpm/kernels/models.inc" CONTENT "${_mpm_names}")
target_include_directories(mpm_flags INTERFACE "${_mpm_generated}")

# What the CPU's simulations are compiled for, a unit of src/solver/cpu each: mpm/solver/
# cpu_domains.inc says MPM_DOMAIN(precision, numbers, dimension) for each that is built. Without
# a dimension in its name a unit is for three.
set(_mpm_domains single single_2d double double_2d)
foreach(domain IN LISTS LIBMPM_DOMAINS)
  if(NOT domain IN_LIST _mpm_domains)
    list(JOIN _mpm_domains ", " known)
    message(FATAL_ERROR "LIBMPM_DOMAINS names ${domain}; there are ${known}")
  endif()
endforeach()
set(MPM_LEFT_OUT_DOMAINS "")
set(_mpm_names "")
foreach(domain IN LISTS _mpm_domains)
  if(LIBMPM_DOMAINS AND NOT domain IN_LIST LIBMPM_DOMAINS)
    list(APPEND MPM_LEFT_OUT_DOMAINS ${domain})
  else()
    string(REGEX REPLACE "^([a-z]+)$" "\\1_3d" name "${domain}")
    string(REGEX REPLACE "^([a-z]+)_([23])d$" "\\1, \\1, \\2" name "${name}")
    string(REPLACE ", single" ", float" name "${name}")
    string(APPEND _mpm_names "MPM_DOMAIN(${name})\n")
  endif()
endforeach()
file(CONFIGURE OUTPUT "${_mpm_generated}/mpm/solver/cpu_domains.inc" CONTENT "${_mpm_names}")

# mpm_instantiate(<backend> <out>): one unit per model, written from
# src/kernels/instantiate_<backend>*.in with @MODEL@ (TaitFluid), @MODEL_HEADER@ (tait_fluid) and
# @PART@ (0: all; of long models 1 to 4 on the CPU). One source per model, not per kernel: the
# latter doubles the compile time.
function(mpm_instantiate backend out)
  file(GLOB templates CONFIGURE_DEPENDS
    "${PROJECT_SOURCE_DIR}/src/kernels/instantiate_${backend}*.in")
  set(units)
  foreach(template IN LISTS templates)
    cmake_path(GET template STEM LAST_ONLY stem_and_suffix) # instantiate_cpu.cpp
    cmake_path(GET stem_and_suffix STEM stem)
    cmake_path(GET stem_and_suffix EXTENSION suffix)
    foreach(MODEL IN LISTS MPM_MODELS)
      mpm_model_header(${MODEL} MODEL_HEADER)
      set(parts 0)
      if(backend STREQUAL cpu AND MODEL IN_LIST MPM_LONG_MODELS)
        set(parts 1 2 3 4)
      endif()
      foreach(PART IN LISTS parts)
        string(REGEX REPLACE "^0$" "" number "${PART}")
        set(unit "${_mpm_generated}/${stem}_${MODEL_HEADER}${number}${suffix}")
        configure_file("${template}" "${unit}" @ONLY)
        list(APPEND units "${unit}")
      endforeach()
    endforeach()
  endforeach()
  set(${out} ${units} PARENT_SCOPE)
endfunction()
