#!/bin/sh
# Every fuzz target over its seeds and a few hundred fixed mutations of them (`make fuzz` for more).
set -u
cd "$PALPATE_SOURCE" || exit 1
PALPATE_READER=$PALPATE_BUILD/palpate-reader; export PALPATE_READER
n=0
for target in "$PALPATE_BUILD"/tests/fuzz/seeds_*; do
	n=$((n + 1))
	name=${target##*/seeds_}
	case $name in
	surface) mutations=5 ;; # a process for each
	model | recorded | frames) mutations=10 ;;
	*) mutations=100 ;;
	esac
	if "$target" $mutations tests/fuzz/corpus/"$name"/* >"$PALPATE_CACHE/seeds" 2>&1; then
		echo "ok $n - $name"
	else
		sed 's/^/# /' "$PALPATE_CACHE/seeds" | tail -n 30
		echo "not ok $n - $name"
	fi
done
[ "$n" -ge 8 ] || echo "not ok $((n + 1)) - there are $n targets"
echo "1..$n"
