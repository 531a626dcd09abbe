# shellcheck shell=bash disable=SC2154,SC2046  # sourced by toolchain/sysroot, which sets triplet, work and made
# How the libraries are compiled of which Debian ships no archive that can be linked statically (libfmt,
# libfreenect: none at all; libusb's wants libudev, of which there is none; libdc1394's wants libraw1394).

library_flags() {
  echo "-O2 -DNDEBUG -ffunction-sections -fdata-sections -fstack-protector-strong -D_FORTIFY_SOURCE=2" \
    "-fPIE -ffile-prefix-map=$work/source=. -ffile-prefix-map=$work=."
}

# Runs one library's steps in a folder of its own; shows their output only when they fail.
library() {  # NAME FUNCTION
  local log=$work/$1.log
  mkdir -p "$work/build/$1"
  (cd "$work/build/$1" && set -e && "$2" "$work/source/$1") >"$log" 2>&1 || {
    tail -n 30 "$log" >&2
    die "$1 could not be compiled"
  }
  # Whoever receives the static program must be able to link it anew with another libusb or libdc1394.
  install -d "$made/usr/share/doc/$1"
  find "$work/source/$1" -maxdepth 1 \( -name 'COPYING*' -o -name 'LICENSE*' -o -name 'GPL2' -o -name 'APACHE20' \) \
    -exec cp {} "$made/usr/share/doc/$1/" \;
}

build_fmt() {
  local file
  for file in format os; do
    "$triplet-g++" -std=c++20 $(library_flags) -I"$1/include" -c "$1/src/$file.cc" -o "$file.o"
  done
  "$triplet-ar" rcsD libfmt.a format.o os.o
  install -Dm644 libfmt.a "$made/usr/lib/$triplet/libfmt.a"
  install -d "$made/usr/include/fmt" "$made/usr/lib/$triplet/cmake/fmt"
  cp "$1"/include/fmt/*.h "$made/usr/include/fmt/"
  # As fmt's own: the target is called fmt::fmt.
  cat >"$made/usr/lib/$triplet/cmake/fmt/fmt-config.cmake" <<'CMAKE'
get_filename_component(fmt_root "${CMAKE_CURRENT_LIST_DIR}/../../../.." ABSOLUTE)
if(NOT TARGET fmt::fmt)
  add_library(fmt::fmt STATIC IMPORTED GLOBAL)
  get_filename_component(fmt_archive "${CMAKE_CURRENT_LIST_DIR}/../../libfmt.a" ABSOLUTE)
  set_target_properties(fmt::fmt PROPERTIES IMPORTED_LOCATION "${fmt_archive}"
                        INTERFACE_INCLUDE_DIRECTORIES "${fmt_root}/include")
endif()
CMAKE
}

configure_and_install() {  # SOURCE ARGS...
  local source=$1
  shift
  CC=$triplet-gcc AR=$triplet-ar RANLIB=$triplet-ranlib CFLAGS=$(library_flags) \
    PKG_CONFIG_LIBDIR="$made/usr/lib/$triplet/pkgconfig" PKG_CONFIG_SYSROOT_DIR="$made" \
    "$source/configure" --host="$triplet" --build="$(uname -m)-linux-gnu" --prefix=/usr \
    --libdir="/usr/lib/$triplet" --disable-shared --enable-static "$@"
  make -j"$(nproc)" V=1
  make install DESTDIR="$made"
}

# Hotplug comes through netlink instead of udev.
build_usb() { configure_and_install "$1" --disable-udev --disable-examples-build --disable-tests-build; }

build_dc1394() {
  configure_and_install "$1" --disable-examples --disable-sdltest --disable-doxygen-doc \
    ac_cv_func_malloc_0_nonnull=yes ac_cv_func_realloc_0_nonnull=yes \
    ac_cv_lib_raw1394_raw1394_channel_modify=no
}

build_freenect() {
  local file objects=()
  for file in core tilt cameras flags usb_libusb10 registration audio loader; do
    "$triplet-gcc" $(library_flags) -I"$1/include" -I"$1/src" -I"$made/usr/include/libusb-1.0" \
      -w -c "$1/src/$file.c" -o "$file.o"
    objects+=("$file.o")
  done
  "$triplet-ar" rcsD libfreenect.a "${objects[@]}"
  install -Dm644 libfreenect.a "$made/usr/lib/$triplet/libfreenect.a"
  install -Dm644 -t "$made/usr/include" "$1/include/libfreenect.h" "$1/include/libfreenect_registration.h"
  cat >"$made/usr/lib/$triplet/pkgconfig/libfreenect.pc" <<PC
prefix=/usr
Name: libfreenect
Description: Interface to the Microsoft Kinect sensor device.
Version: 0.5.3
Requires: libusb-1.0
Libs: -L\${prefix}/lib/$triplet -lfreenect
Cflags: -I\${prefix}/include
PC
}

build_libraries() {
  library fmtlib build_fmt
  library libusb-1.0 build_usb
  library libdc1394 build_dc1394
  library libfreenect build_freenect
}
