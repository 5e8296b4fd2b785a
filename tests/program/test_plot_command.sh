#!/bin/sh
# `palpate plot`: a picture from a recording, its report agreeing with the recording, located errors.
set -u
. "$PALPATE_SOURCE/tests/support/shell.sh"
small_scene '{kind: press, depth: 0.002}'
"$PALPATE" run "$work/scene.yaml" --for 2 --freewheel --no-draw --record "$work/r.h5" --json >"$work/run" 2>"$work/log"
check "a recording" $?
"$PALPATE" plot "$work/r.h5" --json >"$work/json" 2>"$work/log"
check "plot" $?
[ "$(head -c 8 "$work/r.png" | od -An -tx1 | tr -d ' ')" = 89504e470d0a1a0a ]
check "the picture is a PNG beside the recording" $?
[ "$(tail -c +17 "$work/r.png" | head -c 8 | od -An -tx1 | tr -d ' ')" = 00000500000003c0 ]
check "of 1280x960" $?
[ "$(number records "$work/json")" = 2000 ]
check "every tick is in it" $?
awk -v a="$(number peak_force "$work/json")" -v b="$(number peak_force "$work/run")" \
	'BEGIN { d = a - b; exit !(a > 0 && d * d <= 1e-20 * b * b) }' # the same numbers, printed
check "the peak force is the run's" $?
"$PALPATE" plot "$work/r.h5" -o "$work/part.png" --from 0.5 --to 0.75 --size 800x600 --json >"$work/json" 2>"$work/log" &&
	[ "$(number records "$work/json")" = 251 ] && [ -s "$work/part.png" ]
check "a part of it, in another size" $?
! "$PALPATE" plot "$work/r.h5" --from 7 >"$work/json" 2>"$work/log" && grep -q "no time to show" "$work/log"
check "a time before which it ends is an error" $?
! "$PALPATE" plot "$work/r.h5" -o "$work/none/x.png" >"$work/json" 2>"$work/log" && grep -q "none/x.png" "$work/log"
check "a picture that cannot be written is named" $?
! "$PALPATE" plot "$work/missing.h5" --json >"$work/json" 2>"$work/log" &&
	grep -q "missing.h5" "$work/log" && grep -q '"error"' "$work/json"
check "a missing recording is named, in JSON too" $?
printf '\377' | dd of="$work/r.h5" bs=1 seek=5000 conv=notrunc 2>/dev/null
! "$PALPATE" plot "$work/r.h5" -o "$work/bad.png" >"$work/json" 2>"$work/log" && grep -q corrupted "$work/log" && [ ! -e "$work/bad.png" ]
check "a damaged recording is refused by its seal" $?
finish
