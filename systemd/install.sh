#!/bin/sh
# Puts landslope from this checkout onto this machine: sudo sh systemd/install.sh [PREFIX]
# One environment is made where the service runs it, and everything is downloaded once. Run again, it upgrades.
set -eu

prefix=${1:-/opt/landslope}
checkout=$(cd "$(dirname "$0")/.." && pwd)

if [ "$(id -u)" -ne 0 ]; then
    echo "install.sh: needs root: sudo sh systemd/install.sh" >&2
    exit 2
fi
if ! python3 -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    echo "install.sh: needs Python 3.11 or newer with venv: apt install python3-venv" >&2
    exit 2
fi
[ -x "$prefix/bin/python" ] || python3 -m venv "$prefix"
"$prefix/bin/pip" install --quiet --upgrade "$checkout"
exec "$prefix/bin/landslope" install --prefix "$prefix"
