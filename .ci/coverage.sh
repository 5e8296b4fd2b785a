#!/bin/sh
# Line coverage of the two libraries (haptic/ and src/ without the programs in them) after a coverage build. Usage: coverage.sh BUILD
set -eu
build=$1
find "$build/obj/haptic" "$build/obj/src" -name '*.gcda' | grep -vE '/(program|view|mesher|reader)/' | sort | while read -r f; do
	gcov -n "$f" 2>/dev/null | awk -v obj="$f" '
		/^File /{ file=$2; gsub("\x27", "", file) }
		/^Lines executed:/{ split($0, a, /[:% ]+/); if (file ~ /^(haptic|src)\/([a-z]+\/)?[^\/]*\.c$/ && file !~ /\/(program|view|mesher|reader)\//) print file, a[3], a[5]; file="" }'
done | sort -u | awk '
	{ n[$1] = $3; if ($2 > p[$1]) p[$1] = $2 }
	END { for (f in n) { printf "%6.1f %% of %5d  %s\n", p[f], n[f], f; hit += p[f] * n[f] / 100; all += n[f] }
	      printf "%6.1f %% of %5d  lines of the libraries\n", 100 * hit / all, all }' | sort -k5
