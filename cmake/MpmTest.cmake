# mpm_add_tests(<folder> LINKS <target>...): every <folder>/<floor>/*.cpp becomes one executable and
# one ctest entry named <floor>.<stem>, labelled with its floor; the target mpm_tests builds them
# all. What lies in <folder>/support is compiled once and linked to each.
# mpm_check_headers(): a ctest entry that compiles every header alone.

find_package(GTest QUIET)
function(mpm_add_tests folder)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "" "LINKS")
  if(NOT GTest_FOUND)
    message(WARNING "GoogleTest was not found (Debian: libgtest-dev): no C++ tests are built")
    return()
  endif()
  add_custom_target(mpm_tests)
  set(longest 300) # s, of one executable
  if(LIBMPM_SANITIZE)
    set(longest 900)
  endif()
  # A third less to compile than -O2. The library that they run, and what lies in support, keep theirs.
  set(optimised "$<$<CONFIG:Release>:-O1>")
  file(GLOB support CONFIGURE_DEPENDS "${folder}/support/*.cpp")
  add_library(mpm_test_support STATIC ${support})
  set_source_files_properties(${support} PROPERTIES COMPILE_OPTIONS "${MPM_HOT_SANITIZED}")
  target_include_directories(mpm_test_support PUBLIC "${folder}")
  target_link_libraries(mpm_test_support PUBLIC ${arg_LINKS} mpm_flags)
  add_dependencies(mpm_test_support mpm_floors)
  file(GLOB sources CONFIGURE_DEPENDS "${folder}/*/*.cpp")
  list(FILTER sources EXCLUDE REGEX "/support/[^/]*$")
  foreach(source IN LISTS sources)
    cmake_path(GET source STEM stem)
    cmake_path(GET source PARENT_PATH floor)
    cmake_path(GET floor FILENAME floor)
    add_executable(test_${floor}_${stem} "${source}")
    target_link_libraries(test_${floor}_${stem}
      PRIVATE mpm_test_support GTest::gtest GTest::gtest_main)
    target_compile_options(test_${floor}_${stem} PRIVATE "${optimised}")
    add_dependencies(test_${floor}_${stem} mpm_floors)
    add_dependencies(mpm_tests test_${floor}_${stem})
    add_test(NAME ${floor}.${stem} COMMAND test_${floor}_${stem})
    # Threads that wait for others on busy cores take no time from them: an eighth of the whole.
    set_tests_properties(${floor}.${stem} PROPERTIES LABELS "unit;${floor}"
      TIMEOUT ${longest} ENVIRONMENT OMP_WAIT_POLICY=passive)
  endforeach()
endfunction()

function(mpm_check_headers)
  get_target_property(eigen Eigen3::Eigen INTERFACE_INCLUDE_DIRECTORIES)
  add_test(NAME headers
    COMMAND "${Python_EXECUTABLE}" "${PROJECT_SOURCE_DIR}/tools/check_headers.py"
      "${PROJECT_SOURCE_DIR}" --compiler "${CMAKE_CXX_COMPILER}" --isystem "${eigen}"
      --include "${PROJECT_BINARY_DIR}/generated")
  set_tests_properties(headers PROPERTIES LABELS "headers" TIMEOUT 300)
endfunction()
