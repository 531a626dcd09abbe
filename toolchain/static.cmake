# The toolchain file of the presets static-x86_64 and static-aarch64 (WAGONSIGHT_ARCHITECTURE says which):
# everything linked statically, from the archives that toolchain/sysroot makes, hardened, and the same
# bytes wherever it is built.
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES WAGONSIGHT_ARCHITECTURE WAGONSIGHT_SYSROOT)
set(WAGONSIGHT_STATIC ON)

if(NOT WAGONSIGHT_SYSROOT)
  execute_process(COMMAND "${CMAKE_CURRENT_LIST_DIR}/sysroot" --path "${WAGONSIGHT_ARCHITECTURE}"
                  OUTPUT_VARIABLE sysroot OUTPUT_STRIP_TRAILING_WHITESPACE RESULT_VARIABLE code)
  if(NOT code EQUAL 0)
    message(FATAL_ERROR "The static libraries of ${WAGONSIGHT_ARCHITECTURE} are not there yet; "
                        "run ./scripts/setup sysroot ${WAGONSIGHT_ARCHITECTURE}")
  endif()
  set(WAGONSIGHT_SYSROOT "${sysroot}")
endif()
# A build folder remembers where its libraries are.
if(WAGONSIGHT_SYSROOT_USED AND NOT WAGONSIGHT_SYSROOT_USED STREQUAL WAGONSIGHT_SYSROOT)
  message(FATAL_ERROR "The recipe of the static libraries has changed since this folder was configured; "
                      "run cmake --fresh --preset static-${WAGONSIGHT_ARCHITECTURE}")
endif()
set(WAGONSIGHT_SYSROOT_USED "${WAGONSIGHT_SYSROOT}" CACHE INTERNAL "")

set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR ${WAGONSIGHT_ARCHITECTURE})
set(triplet ${WAGONSIGHT_ARCHITECTURE}-linux-gnu)
set(CMAKE_C_COMPILER ${triplet}-gcc)
set(CMAKE_CXX_COMPILER ${triplet}-g++)
set(CMAKE_LIBRARY_ARCHITECTURE ${triplet})
if(NOT CMAKE_HOST_SYSTEM_PROCESSOR STREQUAL WAGONSIGHT_ARCHITECTURE)
  set(CMAKE_CROSSCOMPILING_EMULATOR qemu-${WAGONSIGHT_ARCHITECTURE}-static)
endif()

# Libraries, headers and packages only from the sysroot; programs only from this machine.
set(CMAKE_FIND_ROOT_PATH "${WAGONSIGHT_SYSROOT}")
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
set(CMAKE_FIND_LIBRARY_SUFFIXES .a)
set(ENV{PKG_CONFIG_SYSROOT_DIR} "${WAGONSIGHT_SYSROOT}")
set(ENV{PKG_CONFIG_LIBDIR}
    "${WAGONSIGHT_SYSROOT}/usr/lib/${triplet}/pkgconfig:${WAGONSIGHT_SYSROOT}/usr/share/pkgconfig")

set(libraries "${WAGONSIGHT_SYSROOT}/usr/lib/${triplet}")
cmake_path(GET CMAKE_CURRENT_LIST_DIR PARENT_PATH project)
# No path of this machine reaches the binary: messages of broken contracts name files of the project.
set(hardening "-fstack-protector-strong -fstack-clash-protection -U_FORTIFY_SOURCE -D_FORTIFY_SOURCE=2"
    "\"-ffile-prefix-map=${WAGONSIGHT_SYSROOT}/=\" \"-ffile-prefix-map=${project}/=\"")
if(WAGONSIGHT_ARCHITECTURE STREQUAL "x86_64")
  list(APPEND hardening "-fcf-protection")
else()
  list(APPEND hardening "-mbranch-protection=standard")
endif()
list(JOIN hardening " " hardening)
set(CMAKE_C_FLAGS_INIT "${hardening}")
set(CMAKE_CXX_FLAGS_INIT "${hardening}")
# -B: the start files, too, are those of the pinned C library; -L goes before the compiler's own folders.
set(CMAKE_EXE_LINKER_FLAGS_INIT
    "-static-pie -B${libraries}/ -L${libraries} -Wl,-z,relro,-z,now,-z,noexecstack,--build-id=sha1")
if(WAGONSIGHT_ARCHITECTURE STREQUAL "x86_64")
  # 5,000 relocations in one kilobyte instead of 120; the linker of Debian 12 cannot do it for aarch64.
  string(APPEND CMAKE_EXE_LINKER_FLAGS_INIT ",-z,pack-relative-relocs")
endif()
