#!/bin/sh
# Build the online library in several ways and compare the hashes golden.c prints with each other and
# with tests/golden/hashes. Usage: MAKE= BUILD= JOBS= compare.sh; UPDATE=1 writes hashes anew (when a
# change of the forces is meant). Variants run in the order given; ONLY="name name" picks some.
set -u
hashes=tests/golden/hashes
mkdir -p "$BUILD"
first= failed=0
variant() { # name, compiler, level, more flags
	case " ${ONLY:-$1} " in *" $1 "*) ;; *) return ;; esac
	dir=$BUILD/$1
	if ! $MAKE --no-print-directory -j"${JOBS:-2}" golden-driver BUILD="$dir" CC="$2" OPT="$3" CFLAGS="$4" WERROR= \
		>"$BUILD/$1.log" 2>&1; then
		tail -n 20 "$BUILD/$1.log"
		echo "golden: $1: does not build"
		failed=1
		return
	fi
	if ! "$dir/golden-driver" >"$BUILD/$1.out"; then
		echo "golden: $1: does not run"
		failed=1
		return
	fi
	# every field kernel of a scenario must give the line of the first one
	repeated=$(awk -F: '/field:/{ if (($1 in seen) && seen[$1] != $2) n++; seen[$1] = $2 } END { print n + 0 }' "$BUILD/$1.out")
	if [ "$repeated" -ne 0 ]; then
		echo "golden: $1: $repeated lines differ between field kernels"
		failed=1
	fi
	sort -u "$BUILD/$1.out" >"$BUILD/$1.lines"
	first=${first:-$1}
	if cmp -s "$BUILD/$first.lines" "$BUILD/$1.lines"; then
		echo "golden: $1: $(wc -l <"$BUILD/$1.lines") lines, as $first"
	else
		echo "golden: $1 differs from $first:"
		diff "$BUILD/$first.lines" "$BUILD/$1.lines"
		failed=1
	fi
}
variant gcc-O2 gcc "-O2" ""
variant gcc-O0 gcc "-O0" ""
variant gcc-O3-v3 gcc "-O3 -march=x86-64-v3" ""
variant gcc-O2-baseline gcc "-O2" "-DPALPATE_DENSE_BASELINE"
variant clang-O2 clang "-O2" ""
variant clang-O0 clang "-O0" ""
variant clang-O3-v3 clang "-O3 -march=x86-64-v3" ""
# the comparison can fail: fused multiply-adds, which the Makefile forbids, change bits
if [ -z "${ONLY:-}" ]; then
	failed_before=$failed
	variant control-contracted gcc "-O2 -march=x86-64-v3" "-ffp-contract=fast" >"$BUILD/control.log"
	if [ $failed -eq $failed_before ] && [ "$failed_before" -eq 0 ]; then
		echo "golden: fused multiply-adds changed nothing: the comparison is blind"
		failed=1
	else
		failed=$failed_before
		echo "golden: control: $(grep -c '^>' "$BUILD/control.log") lines change with fused multiply-adds"
	fi
fi
if [ -n "${UPDATE:-}" ]; then
	cp "$BUILD/$first.lines" $hashes
elif [ -f $hashes ] && ! cmp -s "$BUILD/$first.lines" $hashes; then
	echo "golden: the forces are not those of $hashes (make golden UPDATE=1 when that is meant):"
	diff $hashes "$BUILD/$first.lines" | head -n 20
	failed=1
fi
exit $failed
