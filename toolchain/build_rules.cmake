# How every target of wagonsight is built: language level, warnings, the shape of a module.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/bin")

add_library(wagonsight_flags INTERFACE)
target_compile_options(wagonsight_flags INTERFACE
  -Wall -Wextra -Wconversion -Wsign-conversion -Wshadow -Wnon-virtual-dtor -Woverloaded-virtual
  $<$<BOOL:${WAGONSIGHT_WERROR}>:-Werror>
  # g++ 12 warns falsely about "text" + std::string (GCC bug 105651).
  $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
  # x86-64 and aarch64 must give the same bytes, so no fused multiply-add behind our back.
  -ffp-contract=off
  -ffunction-sections -fdata-sections)
target_link_options(wagonsight_flags INTERFACE -Wl,--gc-sections)

# Debian's own headers are not ours to warn about; imported targets are SYSTEM already.
find_package(Threads REQUIRED)
find_package(Eigen3 REQUIRED NO_MODULE)
find_package(tl-expected REQUIRED)
find_package(fmt REQUIRED)
find_package(nlohmann_json REQUIRED)

# wagonsight_module(NAME SOURCES a.cpp ... DEPENDS base ... LINKS Eigen3::Eigen ...)
# A folder of modules/ or platform/ becomes the library wagonsight_NAME. Headers are included as
# "NAME/header.h". The include graph is held against tests/module_graph.txt by a test.
function(wagonsight_module name)
  cmake_parse_arguments(arg "" "" "SOURCES;DEPENDS;LINKS;PRIVATE_LINKS" ${ARGN})
  cmake_path(GET CMAKE_CURRENT_SOURCE_DIR PARENT_PATH include_root)
  if(arg_SOURCES)
    set(kind PUBLIC)
    add_library(wagonsight_${name} STATIC ${arg_SOURCES})
    target_link_libraries(wagonsight_${name} PRIVATE wagonsight_flags ${arg_PRIVATE_LINKS})
  else()
    set(kind INTERFACE)
    add_library(wagonsight_${name} INTERFACE)
  endif()
  target_include_directories(wagonsight_${name} ${kind} "${include_root}")
  list(TRANSFORM arg_DEPENDS PREPEND wagonsight_)
  target_link_libraries(wagonsight_${name} ${kind} ${arg_DEPENDS} ${arg_LINKS})
endfunction()

# wagonsight_program(NAME SOURCES ... DEPENDS ... LINKS ...): an executable of apps/.
function(wagonsight_program name)
  cmake_parse_arguments(arg "" "" "SOURCES;DEPENDS;LINKS" ${ARGN})
  add_executable(${name} ${arg_SOURCES})
  list(TRANSFORM arg_DEPENDS PREPEND wagonsight_)
  target_link_libraries(${name} PRIVATE wagonsight_flags ${arg_DEPENDS} ${arg_LINKS})
  if(WAGONSIGHT_STATIC)  # toolchain/static.cmake
    target_link_options(${name} PRIVATE -s)
  endif()
endfunction()

# wagonsight_test(NAME SOURCES ... DEPENDS ... LINKS ...): one GoogleTest program, found by CTest.
# LABELS threaded marks what the thread sanitizer run repeats; live, scenario and release_only what the
# address sanitizer run leaves out. SERIAL: its tests share a file, so that no two of them run at a time.
add_custom_target(threaded_tests)
add_custom_target(sanitized_tests)
function(wagonsight_test name)
  cmake_parse_arguments(arg "SERIAL" "" "SOURCES;DEPENDS;LINKS;LABELS" ${ARGN})
  add_executable(${name} ${arg_SOURCES})
  list(TRANSFORM arg_DEPENDS PREPEND wagonsight_)
  target_link_libraries(${name} PRIVATE wagonsight_flags ${arg_DEPENDS} ${arg_LINKS} GTest::gmock_main)
  target_compile_definitions(${name} PRIVATE WAGONSIGHT_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  if(WAGONSIGHT_STATIC)  # what is tested is optimised; the tests themselves are to compile fast
    target_compile_options(${name} PRIVATE -O1)
  endif()
  set(labels unit)
  if(arg_LABELS)
    set(labels ${arg_LABELS})
  endif()
  if("threaded" IN_LIST labels)
    add_dependencies(threaded_tests ${name})
  endif()
  if(NOT labels MATCHES "live|scenario|release_only")
    add_dependencies(sanitized_tests ${name})
  endif()
  set(alone "")
  if(arg_SERIAL)
    set(alone RESOURCE_LOCK ${name})
  endif()
  gtest_discover_tests(${name} DISCOVERY_MODE PRE_TEST PROPERTIES ${alone} LABELS ${labels} TIMEOUT 900)
endfunction()

# wagonsight_small(TARGET): never called per frame, so that in the static programs its size counts and not
# its speed.
function(wagonsight_small target)
  if(WAGONSIGHT_STATIC)
    target_compile_options(${target} PRIVATE -Os)
  endif()
endfunction()

# wagonsight_without_ubsan(FILE ...): sources full of Boost.Beast, whose templates take minutes and
# gigabytes under the undefined-behaviour sanitizer. They keep the address sanitizer.
function(wagonsight_without_ubsan)
  set_source_files_properties(${ARGN} PROPERTIES COMPILE_OPTIONS "-fno-sanitize=undefined")
endfunction()

# wagonsight_fuzz(NAME SOURCES a.cpp ... DEPENDS snapshot ...): one target with
# LLVMFuzzerTestOneInput. Under the preset fuzz libFuzzer drives it; under every other preset it is
# built with tests/fuzz/replay_main.cpp, which feeds it the seeds of corpus/NAME (beside its
# CMakeLists.txt, when there are any) and a fixed number of repeatable mutations of them, so that a
# target cannot rot.
add_custom_target(fuzz_targets)
function(wagonsight_fuzz name)
  cmake_parse_arguments(arg "" "" "SOURCES;DEPENDS;LINKS" ${ARGN})
  add_executable(${name} ${arg_SOURCES})
  list(TRANSFORM arg_DEPENDS PREPEND wagonsight_)
  target_link_libraries(${name} PRIVATE wagonsight_flags ${arg_DEPENDS} ${arg_LINKS})
  set(corpus "${CMAKE_CURRENT_SOURCE_DIR}/corpus/${name}")
  if(NOT IS_DIRECTORY "${corpus}")
    set(corpus "")
  endif()
  if(WAGONSIGHT_FUZZ)
    target_link_options(${name} PRIVATE -fsanitize=fuzzer)
    # What libFuzzer finds goes into the first folder; the seeds of the source tree stay as they are.
    set(found "${CMAKE_CURRENT_BINARY_DIR}/found/${name}")
    file(MAKE_DIRECTORY "${found}")
    add_test(NAME fuzz.${name} COMMAND ${name} -max_total_time=${WAGONSIGHT_FUZZ_SECONDS}
             -timeout=10 -rss_limit_mb=2048 -print_final_stats=1
             "-artifact_prefix=${found}/" "${found}" ${corpus})
  else()
    target_sources(${name} PRIVATE "${PROJECT_SOURCE_DIR}/tests/fuzz/replay_main.cpp")
    add_test(NAME fuzz.${name} COMMAND ${name} ${corpus})
  endif()
  add_dependencies(fuzz_targets ${name})
  add_dependencies(sanitized_tests ${name})
  set_tests_properties(fuzz.${name} PROPERTIES LABELS fuzz TIMEOUT 300)
endfunction()
