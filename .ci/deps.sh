#!/bin/sh
# Install the Debian packages named that are missing, and say which. Usage: deps.sh PACKAGE...
set -eu
missing=""
for p in "$@"; do
	if ! dpkg-query -W -f='${Status}' "$p" 2>/dev/null | grep -q 'install ok installed'; then
		missing="$missing $p"
	fi
done
[ -n "$missing" ] || exit 0
echo "palpate: installing missing Debian packages:$missing" >&2
if [ "$(id -u)" = 0 ]; then run=""; elif command -v sudo >/dev/null 2>&1; then run=sudo; else
	echo "palpate: neither root nor sudo: install them by hand:" >&2
	echo "  apt-get install$missing" >&2
	exit 1
fi
log=$(mktemp)
try() {
	# shellcheck disable=SC2086
	DEBIAN_FRONTEND=noninteractive $run apt-get install -y -q --no-install-recommends $missing >"$log" 2>&1
}
if ! try; then
	$run apt-get update -q >>"$log" 2>&1 || true
	try || { cat "$log" >&2; rm -f "$log"; echo "palpate: apt-get install failed (above)" >&2; exit 1; }
fi
rm -f "$log"
