#!/usr/bin/env bash
# flash.sh FLASH: writes an image into a file that stands for a disk, and tries what must be refused by name.
set -uo pipefail
flash=$1
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch" || exit 1
failures=0

refuses() {  # WORDS ARGUMENTS...: ends with 1, says WORDS, and changes no file
  local words=$1 before after told
  shift
  before=$(sha256sum image disk small)
  told=$("$flash" "$@" 2>&1 </dev/null) && { echo "FAIL: taken: $*"; failures=1; }
  grep -q "$words" <<<"$told" || { echo "FAIL: '$told' does not say '$words'"; failures=1; }
  after=$(sha256sum image disk small)
  [ "$before" = "$after" ] || { echo "FAIL: a refusal wrote something"; failures=1; }
}

head -c 300000 /dev/urandom >image
head -c 400000 /dev/zero >disk
head -c 100000 /dev/zero >small
refuses "is no disk" image disk --yes
export WAGONSIGHT_FLASH_FILE=yes
refuses "the image needs" image small --yes
refuses "say --yes" image disk
refuses "is no disk" image /dev/null --yes
refuses "is not there" absent disk --yes
refuses "is not there" image absent --yes
# The disk that carries the root of this machine, where there is one.
system=$(awk '$2 == "/" && $1 ~ "^/dev/" {print $1}' /proc/mounts | head -n 1)
if [ -b "$system" ]; then refuses "is mounted\|is a partition" image "$system" --yes; fi

"$flash" image disk --yes >/dev/null || { echo "FAIL: not written"; failures=1; }
cmp -n 300000 image disk || failures=1
[ "$(tail -c 100000 disk | tr -d '\0' | wc -c)" = 0 ] || { echo "FAIL: wrote beyond the image"; failures=1; }
exit $failures
