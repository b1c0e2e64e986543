#!/bin/sh
# Builds the Debian package from this checkout, for Bookworm and Trixie, on any machine with dpkg-deb:
#   sh systemd/debian/build.sh [--arch amd64|arm64] [--pythons "3.11 3.13"] [--wheels FOLDER] [OUT]
# It contains the wheels of landslope and of all it needs; the board makes the environment of them without a network.
# Wheels are downloaded, or taken from FOLDER where one is given. PYTHON: a Python that has landslope's dependencies.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
checkout=$(cd "$here/../.." && pwd)
arch=amd64
pythons="3.11 3.13"
given=
while [ $# -gt 0 ]; do
    case "$1" in
    --arch) arch=$2; shift 2 ;;
    --pythons) pythons=$2; shift 2 ;;
    --wheels) given=$(cd "$2" && pwd); shift 2 ;;
    -*) echo "build.sh: $1: unknown; see its first lines" >&2; exit 2 ;;
    *) break ;;
    esac
done
out=${1:-$checkout/dist}
python=${PYTHON:-$checkout/.venv/bin/python}
case "$arch" in
amd64) machine=x86_64 ;;
arm64) machine=aarch64 ;;
*) echo "build.sh: --arch $arch: amd64 or arm64" >&2; exit 2 ;;
esac

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
root=$work/root
# a copy: setuptools would put modules of earlier builds into the wheel
mkdir -p "$work/source" "$out"
(cd "$checkout" && cp -r pyproject.toml README.md LICENSE companion drivers landing systemd "$work/source")
version=$("$python" -c 'import sys, tomllib; print(tomllib.load(open(sys.argv[1], "rb"))["project"]["version"])' \
    "$checkout/pyproject.toml")

wheels=$root/usr/share/landslope/wheels
mkdir -p "$wheels"
if [ -n "$given" ]; then
    cp "$given"/*.whl "$wheels"
else
    "$python" -m pip wheel --quiet --no-deps --wheel-dir "$wheels" "$work/source"
    for wanted in $pythons; do
        "$python" -m pip download --quiet --only-binary :all: --implementation cp --python-version "$wanted" \
            --platform "manylinux_2_28_$machine" --platform "manylinux_2_17_$machine" --platform "manylinux2014_$machine" \
            --dest "$wheels" "$wheels/landslope-$version-py3-none-any.whl"
    done
fi

put() { # put FILE TARGET: one file of systemd/ into the package
    mkdir -p "$root/$(dirname "$2")"
    cp "$checkout/systemd/$1" "$root/$2"
}
put landslope.service usr/lib/systemd/system/landslope.service
put landslope.sysusers.conf usr/lib/sysusers.d/landslope.conf
put 70-landslope.rules usr/lib/udev/rules.d/70-landslope.rules
put landslope.toml etc/landslope/landslope.toml
put zenoh.json5 etc/landslope/zenoh.json5
document() { # document KIND TARGET
    mkdir -p "$root/$(dirname "$2")"
    (cd "$checkout" && PYTHONPATH=$checkout "$python" -m companion.cli completion "$1") >"$root/$2"
}
document bash usr/share/bash-completion/completions/landslope
document zsh usr/share/zsh/vendor-completions/_landslope
document man usr/share/man/man1/landslope.1
gzip -9n "$root/usr/share/man/man1/landslope.1"
mkdir -p "$root/usr/bin" "$root/usr/share/doc/landslope"
ln -s /opt/landslope/bin/landslope "$root/usr/bin/landslope"
cp "$checkout/LICENSE" "$root/usr/share/doc/landslope/copyright"

mkdir -p "$root/DEBIAN"
for script in preinst postinst prerm postrm; do
    install -m 755 "$here/$script" "$root/DEBIAN/$script"
done
cp "$here/triggers" "$root/DEBIAN/triggers"
printf '/etc/landslope/landslope.toml\n/etc/landslope/zenoh.json5\n' >"$root/DEBIAN/conffiles"
oldest=${pythons%% *}
newest=${pythons##* }
sed -e "s/@VERSION@/$version/" -e "s/@ARCH@/$arch/" -e "s/@OLDEST@/$oldest/" \
    -e "s/@AFTER@/3.$((${newest#3.} + 1))/" -e "s/@SIZE@/$(du -sk "$root" | cut -f1)/" \
    "$here/control.in" >"$root/DEBIAN/control"
(cd "$root" && find . -path ./DEBIAN -prune -o -type f -printf '%P\0' | xargs -0 md5sum >DEBIAN/md5sums)
chmod -R u=rwX,go=rX "$root"
# wheels are compressed already
dpkg-deb --root-owner-group -Znone --build "$root" "$out/landslope_${version}_$arch.deb"
