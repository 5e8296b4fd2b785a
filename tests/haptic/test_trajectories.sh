#!/bin/sh
# The shipped trajectories are what their generator writes (to the last digit or one: libm), and
# each is a stroke a trainee could make: it begins above the surface, ends at 10 s, at most 2 m/s.
set -u
if [ "${VARIANT:-plain}" != plain ]; then
	echo "1..0 # SKIP the generator links the plain shared library"
	exit 0
fi
. "$PALPATE_SOURCE/tests/support/shell.sh"
here=$PALPATE_SOURCE/scenes
"$CC" -I"$PALPATE_SOURCE/include" -I"$PALPATE_SOURCE" "$here/make_trajectories.c" \
	"$PALPATE_BUILD/libpalpate.so" -Wl,-rpath,"$PALPATE_BUILD" -o "$work/make" &&
	mkdir "$work/out" && "$work/make" "$work/out"
check "generator compiles and runs" $?
[ "$(ls "$work/out")" = "$(cd "$here/trajectories" && ls)" ]
check "the same nine files" $?
for f in "$here"/trajectories/*.csv; do
	name=$(basename "$f")
	paste -d, "$f" "$work/out/$name" | awk -F, '
		NF != 18 { exit 1 }
		NR == 1 { next }
		{ for (i = 1; i <= 9; i++) { d = $i - $(i + 9); if (d > 1.1e-8 || d < -1.1e-8) exit 1 }
		  if (NR > 2) { dt = $1 - t; v = (($2-x)^2 + ($3-y)^2 + ($4-z)^2)^0.5 / dt; if (v > 2) exit 1 }
		  t = $1; x = $2; y = $3; z = $4 }
		END { exit !(t == 10) }'
	check "$name" $?
done
finish
