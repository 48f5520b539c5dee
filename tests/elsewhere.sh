#!/bin/sh
# Runs jobs of ./run on a bare Debian of another version: debootstrap makes it in build/elsewhere/SUITE, a clone of what
# is committed here is put into it, and `./run JOB` is called there as a new user would call it: that call installs
# everything. System and clone are kept for the next call; remove the folder to begin with a bare one.
#
# usage: tests/elsewhere.sh [SUITE [JOB...]]     as root; SUITE trixie (default) or bookworm, JOBs demo and test (default)
set -eu
cd "$(dirname "$0")/.."

suite=${1:-trixie}
[ $# -eq 0 ] || shift
[ $# -gt 0 ] || set -- demo test

fail() { echo "elsewhere: $*" >&2; exit 2; }
case $suite in *[!a-z]* | "") fail "'$suite' is no name of a Debian: trixie, bookworm, ..." ;; esac
[ "$(id -u)" -eq 0 ] || fail "making a system needs root: sudo ./run elsewhere $suite"
for program in debootstrap unshare chroot git; do
  command -v $program >/dev/null || fail "$program was not found; as root: apt-get install debootstrap util-linux coreutils git"
done

root=$(pwd)/build/elsewhere/$suite
if [ ! -f "$root/made" ]; then
  rm -rf "$root"
  mkdir -p "$root"
  debootstrap --variant=minbase "$suite" "$root" >"$root.log" 2>&1 || { cat "$root.log" >&2; fail "debootstrap $suite failed"; }
  touch "$root/made"
fi
cp /etc/resolv.conf "$root/etc/resolv.conf"
# Behind a proxy of one's own, npm must trust what this machine trusts.
authorities=/etc/ssl/certs/ca-certificates.crt
[ ! -f $authorities ] || cp $authorities "$root/etc/elsewhere-authorities.crt"
clone=$root/brume
[ -d "$clone" ] || git clone -q . "$clone"
git -C "$clone" fetch -q "$(pwd)" HEAD
git -C "$clone" checkout -q --force --detach FETCH_HEAD
[ -z "$(git status --porcelain)" ] || echo "elsewhere: what is not committed is left out" >&2

# Mounts of a name space of their own end with it.
for job in "$@"; do
  echo "== $suite: ./run $job" >&2
  unshare --mount sh -eu -c '
    root=$1
    for folder in proc sys dev; do mount --rbind "/$folder" "$root/$folder"; done
    if [ -d ../shared ]; then
      mkdir -p "$root/shared"
      mount --bind ../shared "$root/shared"
    fi
    [ ! -f "$root/etc/elsewhere-authorities.crt" ] || export NODE_EXTRA_CA_CERTS=/etc/elsewhere-authorities.crt
    exec env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin TERM="${TERM:-dumb}" LC_ALL=C.UTF-8 \
      ${http_proxy+"http_proxy=$http_proxy"} ${https_proxy+"https_proxy=$https_proxy"} \
      ${NODE_EXTRA_CA_CERTS+"NODE_EXTRA_CA_CERTS=$NODE_EXTRA_CA_CERTS"} \
      chroot "$root" sh -c "cd /brume && exec ./run $2"' sh "$root" "$job"
done
