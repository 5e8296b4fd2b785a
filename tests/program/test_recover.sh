#!/bin/sh
# `palpate run --record` killed with SIGKILL, then `palpate recover`: the recording is there, the raw
# files are gone, and a second run refuses to overwrite an unfinished recording.
set -u
. "$PALPATE_SOURCE/tests/support/shell.sh"
small_scene '{kind: palpation, depth: 0.002, period: 0.5}'
"$PALPATE" precompute "$work/scene.yaml" -o "$work/m.palpate" >"$work/log" 2>&1
check "a small model" $?
"$PALPATE" run "$work/m.palpate" --for 3600 --no-draw --record "$work/r.h5" >"$work/log" 2>&1 &
pid=$!
i=0; size=0
while [ "$i" -lt 600 ] && [ "$size" -lt 100000 ]; do # some 340 records beyond the header
	sleep 0.1; i=$((i + 1))
	size=$(stat -c %s "$work/r.h5.ticks" 2>/dev/null || echo 0)
done
kill -9 "$pid"; wait "$pid" 2>/dev/null
[ -e "$work/r.h5.ticks" ] && [ ! -e "$work/r.h5" ]
check "a killed run leaves its raw files" $?
! "$PALPATE" run "$work/m.palpate" --for 0.1 --freewheel --no-draw --record "$work/r.h5" >"$work/log" 2>&1 &&
	grep -q "palpate recover" "$work/log"
check "which no later run overwrites" $?
"$PALPATE" recover "$work/r.h5" --json >"$work/json" 2>"$work/log"
check "recover succeeds" $?
records=$(number records "$work/json")
[ "${records:-0}" -ge $(((size - 16384) / 248)) ]
check "with every record that was on disk ($records)" $?
grep -q '"complete": *false' "$work/json"
check "and says that the run was killed" $?
[ ! -e "$work/r.h5.ticks" ] && [ ! -e "$work/r.h5.frames" ] && [ -e "$work/r.xdmf" ]
check "the raw files are gone, the companion is there" $?
h5dump -H -d /ticks/force "$work/r.h5" | grep -q "( $records, 3 )"
check "h5dump reads it" $?
! "$PALPATE" recover "$work/r.h5" >"$work/log" 2>&1
check "nothing is left to recover" $?
"$PALPATE" replay "$work/r.h5" --json >"$work/json" 2>"$work/log"
check "the killed run replays, its model found in the cache by its hash" $?
grep -q '"differences": *0' "$work/json" && grep -q '"same_model": *true' "$work/json"
check "without a difference" $?
! PALPATE_CACHE="$work/empty" "$PALPATE" replay "$work/r.h5" >"$work/log" 2>&1 && grep -q -- "--model" "$work/log"
check "a cache without it is an error that says what to give" $?
"$PALPATE" run "$work/m.palpate" --for 0.1 --freewheel --no-draw --record "$work/r.h5" >"$work/log" 2>&1
check "the next run records again" $?

# ---- the ring: dumped on SIGUSR1 and at a fault, also of a run that is killed then
"$PALPATE" run "$work/m.palpate" --for 3600 --no-draw --dump "$work/d.h5" >"$work/log" 2>&1 &
pid=$!
i=0
until [ -e "$work/d.h5.ticks" ] || [ "$i" -ge 600 ]; do
	sleep 0.1; i=$((i + 1))
	# bit 9: it catches SIGUSR1 by now, which would end it before
	grep -q 'SigCgt:.*[2367abef]..$' "/proc/$pid/status" && kill -USR1 "$pid"
done
[ -e "$work/d.h5.ticks" ]
check "SIGUSR1 dumps the last ticks" $?
kill -9 "$pid"; wait "$pid" 2>/dev/null
"$PALPATE" recover "$work/d.h5" >"$work/log" 2>&1
check "a dump of a killed run is recovered" $?
"$PALPATE" replay "$work/d.h5" --json >"$work/json" 2>"$work/log"
grep -q '"same_model": *true' "$work/json"
check "and opens like a recording" $?
"$PALPATE" run "$work/m.palpate" --for 3600 --no-draw --dump "$work/s.h5" --record "$work/t.h5" --json \
	>"$work/json" 2>"$work/log" &
pid=$!
i=0; size=0
while [ "$i" -lt 600 ] && [ "$size" -lt 100000 ]; do
	sleep 0.1; i=$((i + 1))
	size=$(stat -c %s "$work/t.h5.ticks" 2>/dev/null || echo 0)
done
kill -STOP "$pid"; sleep 1.3; kill -CONT "$pid"; sleep 1; kill -INT "$pid"; wait "$pid"
[ $? -eq 130 ] && [ -e "$work/s.h5" ] && [ ! -e "$work/s.h5.ticks" ]
check "a process stopped for 1.3 s has a dump of it" $?
grep -q '"LATCHED"' "$work/json" && grep -q '"latched": *1' "$work/json"
check "and its watchdog is latched, which the report says" $?
"$PALPATE" replay "$work/s.h5" --json 2>"$work/log" | grep -q '"differences": *0'
check "the dump replays without a difference" $?
"$PALPATE" replay "$work/t.h5" --json 2>"$work/log" | grep -q '"differences": *0'
check "and so does the recording" $?
finish
