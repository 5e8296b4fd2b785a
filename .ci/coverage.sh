#!/bin/sh
# Line coverage of the two libraries (haptic/ and src/ without the programs in them) after a coverage
# build and its tests. Files no test has run count as they are: 0 %. Usage: coverage.sh BUILD [LEAST]
# fails when the libraries are covered less than LEAST percent, or when a source of theirs is missing.
set -eu
build=$1 least=${2:-0}
programs='/(program|view|mesher|reader)/'
list=$(mktemp)
trap 'rm -f "$list"' EXIT
find "$build/obj/haptic" "$build/obj/src" -name '*.gcno' | grep -vE "$programs" | sort | while read -r f; do
	source=${f#"$build/obj/"} && source=${source%.gcno}.c
	[ -e "$source" ] || continue # of a file that is no more
	gcov -n "$f" 2>/dev/null | awk -v source="$source" '
		/^File /{ file = $2; gsub("\x27", "", file) }
		/^Lines executed:/{ split($0, a, /[:% ]+/); if (file == source) print file, a[3], a[5]; file = "" }'
done >"$list"
missing=$(find haptic src -name '*.c' | grep -vE "$programs" | while read -r f; do
	[ -e "$build/obj/${f%.c}.gcno" ] || echo "$f"
done)
awk -v least="$least" '
	{ printf "%6.1f %% of %5d  %s\n", $2, $3, $1 | "sort -k5"; hit += $2 * $3 / 100; all += $3 }
	END { close("sort -k5"); p = all ? 100 * hit / all : 0
	      printf "%6.1f %% of %5d  lines of the libraries, %d files\n", p, all, NR; exit p < least }' "$list" || {
	echo "coverage: below $least %"
	exit 1
}
if [ -n "$missing" ]; then
	echo "coverage: not counted:" $missing
	exit 1
fi
