#!/bin/sh
# Run test programs (cmocka, TAP) and scripts (TAP); sum up. Usage: run.sh FILTER TEST...
# Ends with one line "N passed, N failed[, N skipped]"; exit status 0 only when none failed.
set -u
filter=$1; shift
logs=$BUILD/test-logs
rm -rf "$logs"; mkdir -p "$logs"
PALPATE_CACHE=$(mktemp -d); export PALPATE_CACHE
trap 'rm -rf "$PALPATE_CACHE"' EXIT
PALPATE_SOURCE=$(pwd); PALPATE_BUILD=$(cd "$BUILD" && pwd); export PALPATE_SOURCE PALPATE_BUILD
PALPATE=$PALPATE_BUILD/palpate; export PALPATE VARIANT CC
ASAN_OPTIONS=${ASAN_OPTIONS:-detect_leaks=1:allocator_may_return_null=1}; export ASAN_OPTIONS
LSAN_OPTIONS=${LSAN_OPTIONS:-suppressions=$(pwd)/tests/leaks.txt:print_suppressions=0}; export LSAN_OPTIONS
TSAN_OPTIONS=${TSAN_OPTIONS:-halt_on_error=1}; export TSAN_OPTIONS
# ASan's dlopen stands between the program and the loader, which then forgets the program's own RUNPATH
case $VARIANT in asan | ubsan | tsan) LD_LIBRARY_PATH=$PALPATE_BUILD; export LD_LIBRARY_PATH ;; esac
CMOCKA_MESSAGE_OUTPUT=TAP; export CMOCKA_MESSAGE_OUTPUT
OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}; export OPENBLAS_NUM_THREADS

list=""
for t in "$@"; do
	case $(basename "$t") in *"$filter"*) list="$list $t" ;; esac
done
# programs side by side, one per core
export BUILD logs
# shellcheck disable=SC2086
printf '%s\n' $list | xargs -P "${JOBS:-2}" -I{} sh tests/run_one.sh {}
for s in "$logs"/*.sum; do
	if ! grep -q ' 0 failed' "$s"; then
		n=$(basename "$s" .sum)
		echo "---- $n (log: $logs/$n.log)"
		grep -vE '^ok |^1\.\.' "$logs/$n.log" | tail -n 40
	fi
done
grep -h '# [Ss][Kk][Ii][Pp]' "$logs"/*.log 2>/dev/null | sed 's/^/skipped: /'
cat "$logs"/*.sum | awk '{ p += $2; f += $4; s += $6 }
	END { printf "%d passed, %d failed%s\n", p, f, s ? ", " s " skipped" : ""; exit f || !p }'
