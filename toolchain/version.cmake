# version.h for the programs: the version and, where this is a checkout and git is installed, the commit.

find_package(Git QUIET)
set(WAGONSIGHT_COMMIT "")
if(GIT_FOUND)
  execute_process(COMMAND ${GIT_EXECUTABLE} describe --always --dirty
                  WORKING_DIRECTORY "${PROJECT_SOURCE_DIR}" OUTPUT_VARIABLE WAGONSIGHT_COMMIT
                  OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
endif()
if(WAGONSIGHT_COMMIT)
  string(APPEND WAGONSIGHT_COMMIT " ")
endif()
configure_file("${CMAKE_CURRENT_LIST_DIR}/version.h.in" "${CMAKE_BINARY_DIR}/generated/version.h" @ONLY)

# Compiled into the programs alone: no module's object depends on the commit.
add_library(wagonsight_version INTERFACE)
target_include_directories(wagonsight_version INTERFACE "${CMAKE_BINARY_DIR}/generated")
