# shellcheck shell=bash disable=SC2154,SC2046  # sourced by toolchain/sysroot, which sets triplet, work and made
# How the libraries are compiled of which Debian ships no archive that can be linked statically (libfmt,
# libfreenect: none at all; libusb's wants libudev, of which there is none; libdc1394's wants libraw1394), or one that the
# linker cannot take apart: of Debian's zstd and lz4 the unit's daemon got 780 kB, of these it gets 160.

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
    # Nothing is formatted by the locale, and the C++ library's locales are 300 kB.
    "$triplet-g++" -std=c++20 $(library_flags) -DFMT_STATIC_THOUSANDS_SEPARATOR="','" -I"$1/include" -c "$1/src/$file.cc" -o "$file.o"
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

# C without unwinding tables: nobody throws through it.
compile_c() {  # OBJECT SOURCE OPTIONS...
  "$triplet-gcc" $(library_flags) -fno-asynchronous-unwind-tables "${@:3}" -c "$2" -o "$1"
}

install_c_library() {  # NAME, pkg-config's NAME, VERSION, HEADERS...
  "$triplet-ar" rcsD "$1.a" ./*.o
  install -Dm644 "$1.a" "$made/usr/lib/$triplet/$1.a"
  install -Dm644 -t "$made/usr/include" "${@:4}"
  mkdir -p "$made/usr/lib/$triplet/pkgconfig"
  cat >"$made/usr/lib/$triplet/pkgconfig/$2.pc" <<PC
prefix=/usr
Name: $2
Description: $2
Version: $3
Libs: -L\${prefix}/lib/$triplet -l${1#lib}
Cflags: -I\${prefix}/include
PC
}

# Without the decoders of before 1.0 and one variant of each table instead of three. The strategies behind the levels from 5 on
# give way to that of level 1, which is the one we write with; any level still gives a valid frame.
build_zstd() {
  local file kind name row fast=() of=(-DZSTD_LEGACY_SUPPORT=0 -DZSTD_DISABLE_ASM=1 -DZSTD_NO_INLINE
    -DHUF_FORCE_DECOMPRESS_X1 -DZSTD_FORCE_DECOMPRESS_SEQUENCES_SHORT)
  for name in greedy lazy lazy2 btlazy2 btopt btultra btultra2; do
    for kind in '' _extDict _dictMatchState _dedicatedDictSearch; do
      for row in '' _row; do
        fast+=("-DZSTD_compressBlock_$name$kind$row=ZSTD_compressBlock_fast${kind/dedicatedDictSearch/dictMatchState}")
      done
    done
  done
  for file in "$1"/lib/{common,compress,decompress}/*.c; do
    name=$(basename "$file" .c)
    kind=()
    [ "$name" != zstd_compress ] || kind=("${fast[@]}")
    compile_c "$name.o" "$file" "${of[@]}" "${kind[@]}"
  done
  install_c_library libzstd libzstd 1.5.4 "$1"/lib/{zstd,zstd_errors}.h
}

build_lz4() {
  local file
  for file in lz4 lz4hc lz4frame xxhash; do
    compile_c "$file.o" "$1/lib/$file.c" -DXXH_NAMESPACE=LZ4_
  done
  install_c_library liblz4 liblz4 1.9.4 "$1"/lib/{lz4,lz4hc,lz4frame}.h
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
  library libzstd build_zstd
  library lz4 build_lz4
  library libusb-1.0 build_usb
  library libdc1394 build_dc1394
  library libfreenect build_freenect
}
