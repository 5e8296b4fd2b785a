#!/bin/sh
# Where `palpate` writes: a target that cannot be is refused before the work begins, a disk that fills
# up costs the file and not the report, an interrupt leaves whole files or none, nothing is overwritten
# that was read. A folder that cannot be written and a small disk need a mount: without it, skipped.
set -u
. "$PALPATE_SOURCE/tests/support/shell.sh"
trap 'umount "$work/small" "$work/fixed" 2>/dev/null; rm -rf "$work"' EXIT
cd "$work" || exit 1
cat >scene.yaml <<'EOS'
palpate: 1
body:
  geometry: {box: {size: [0.04, 0.04, 0.02], center: [0, 0, -0.01]}}
  spacing: 0.008
  material: {young: 10e3, poisson: 0.4}
  fixed: [{below: {z: -0.02}}]
tools:
  - name: probe
    shape: {sphere: {radius: 0.006}}
    device: {scripted: {kind: palpation, depth: 0.002, period: 0.5}}
    start: [0, 0, 0.006]
    axis: [0, 0, -1]
EOS
# refused TEXT ARGUMENTS...: status 1, TEXT is said, and that before a model is built: the cache stays empty
refused() {
	text=$1; shift
	PALPATE_CACHE="$work/none" "$PALPATE" "$@" >out 2>log
	[ $? -eq 1 ] && grep -qF -- "$text" log && [ ! -e none ]
	check "$(echo "$*" | head -c 80): $text" $?
}
mkdir folder; mkfifo pipe.png pipe.h5
name=$(head -c 240 /dev/zero | tr '\0' a)
for pair in "--snapshot png" "--gif gif" "--record h5" "--dump h5"; do
	option=${pair% *} ending=${pair#* }
	refused "its folder no: No such file or directory; make it first" run scene.yaml "$option" "no/x.$ending"
	refused "scene.yaml is not a folder" run scene.yaml "$option" "scene.yaml/x.$ending"
	refused "a folder; give the name of a file in it" run scene.yaml "$option" folder
	refused "not the name of a file" run scene.yaml "$option" ""
	refused "a name that ends in .$ending is needed" run scene.yaml "$option" x.jpg
	refused "a name that ends in .$ending is needed" run scene.yaml "$option" "./.$ending"
	refused "would overwrite what is read" run scene.yaml "$option" ./scene.yaml
	refused "the name is too long" run scene.yaml "$option" "$name.$ending"
done
refused "is not a regular file" run scene.yaml --snapshot pipe.png
refused "is not a regular file" run scene.yaml --record pipe.h5
refused "the recording goes there" run scene.yaml --record x.h5 --dump x.h5
refused "its folder no: " view scene.yaml --snapshot no/x.png
refused "its folder no: " precompute scene.yaml -o no/x.palpate
refused "would overwrite what is read" precompute scene.yaml -o scene.yaml
PALPATE_CACHE="$work/none" "$PALPATE" run scene.yaml --snapshot no/x.png --json >out 2>log
[ $? -eq 1 ] && grep -q '"error"' out && grep -q "no/x.png" out
check "and in JSON" $?

"$PALPATE" precompute scene.yaml -o m.palpate >out 2>log
check "a model" $?
"$PALPATE" run m.palpate --for 1 --freewheel --no-draw --record R.H5 --json >out 2>log && [ -e R.H5 ]
check "an ending in capitals is one" $?
mv R.H5 r.h5; cp r.h5 kept.h5
for o in "" x.jpg r.h5 folder no/x.png; do
	"$PALPATE" plot r.h5 -o "$o" >out 2>log
	[ $? -eq 1 ] && grep -q -e "--output" log && cmp -s r.h5 kept.h5
	check "plot -o '$o' is refused" $?
done
cp m.palpate m.h5
"$PALPATE" run m.h5 --for 0.1 --freewheel --no-draw --record m.h5 >out 2>log
[ $? -eq 1 ] && cmp -s m.h5 m.palpate
check "no recording over the model that is run" $?

# ---- pictures that cannot be drawn at all are refused before the run, not after it
__EGL_VENDOR_LIBRARY_FILENAMES=/nonexistent EGL_PLATFORM=none "$PALPATE" run m.palpate --for 3600 \
	--snapshot x.png >out 2>log
status=$?
if [ "$status" -eq 0 ]; then
	n=$((n + 1)); echo "ok $n - no OpenGL # SKIP this one ignores its environment"
else
	[ "$status" -eq 1 ] && [ ! -s out ]
	check "no OpenGL: a run of an hour with a picture ends at once" $?
fi

if [ "$status" -eq 1 ]; then
	__EGL_VENDOR_LIBRARY_FILENAMES=/nonexistent EGL_PLATFORM=none "$PALPATE" run m.palpate --for 0.2 \
		--freewheel --json >out 2>log
	[ $? -eq 0 ] && grep -q '"ticks": 200' out && grep -q "^warning: " log
	check "where no picture was asked for that is a warning" $?
fi
mkdir c.xdmf
"$PALPATE" run m.palpate --for 0.1 --freewheel --no-draw --record c.h5 >out 2>log
[ $? -eq 1 ] && grep -q "c.xdmf: exists and is not a regular file" log && [ ! -s out ] && [ ! -e c.h5.ticks ]
check "a folder where the recording's companion must go" $?
(
	ulimit -f 20 # blocks of 512 or 1024 bytes: too little for the headers
	"$PALPATE" run m.palpate --for 0.1 --freewheel --no-draw --record l.h5 >out 2>log
)
[ $? -eq 1 ] && grep -q "l.h5.[a-z]*: cannot be written: \(File too large\|No space left\)" log &&
	[ ! -e l.h5.ticks ] && [ ! -e l.h5.frames ]
check "a file at its limit: the reason is the right one, nothing is left" $?
(
	ulimit -f 128 # enough to begin with; neither the raw files nor the recording fit
	"$PALPATE" run m.palpate --for 2 --freewheel --no-draw --record l.h5 --json >out 2>log
)
[ $? -eq 1 ] && grep -q '"ticks": 2000' out && grep -q "that a file may have here" log && [ ! -e l.h5 ] &&
	[ -z "$(ls l.h5.part* 2>/dev/null)" ] && "$PALPATE" recover l.h5 >out 2>log && [ -s l.h5 ]
check "a limit reached during the run: the report, no crash; what there is can be recovered" $?
rm -f l.h5* l.xdmf

# ---- a disk that fills up during the run
mkdir small fixed
if mount -t tmpfs -o size=64k tmpfs small 2>/dev/null; then
	"$PALPATE" run m.palpate --for 1 --freewheel --snapshot small/x.png --json >out 2>log
	[ $? -eq 1 ] && grep -q '"ticks": 1000' out && grep -q '"error": {' out && grep -q "No space left" out &&
		! grep -q '"snapshot"' out && [ -z "$(ls -A small)" ]
	check "a picture that does not fit: the JSON report all the same, the error in it, nothing left" $?
	"$PALPATE" run m.palpate --for 1 --freewheel --snapshot small/x.png >out 2>log
	[ $? -eq 1 ] && grep -q "^ticks *1000" out && grep -q "No space left" log && ! grep -q "^picture" out
	check "and the text report" $?
	echo old >small/x.gif
	"$PALPATE" run m.palpate --for 2 --freewheel --gif small/x.gif --json >out 2>log
	[ $? -eq 1 ] && grep -q '"ticks": 2000' out && grep -q '"error": {' out && [ "$(ls -A small)" = x.gif ] &&
		[ "$(cat small/x.gif)" = old ]
	check "an animation that does not fit leaves the one that was there" $?
	rm small/x.gif
	"$PALPATE" run m.palpate --for 2 --freewheel --no-draw --record small/x.h5 --json >out 2>log
	[ $? -eq 1 ] && grep -q '"ticks": 2000' out && grep -q '"error": {' out && grep -q "palpate recover" log &&
		[ ! -e small/x.h5 ]
	check "a recording that does not fit: the report, and what to do" $?
	rm -f small/*
	"$PALPATE" precompute scene.yaml -o small/m.palpate >out 2>log
	[ $? -eq 1 ] && grep -q "No space left" log && [ -z "$(ls -A small)" ]
	check "a model that does not fit leaves nothing" $?
	PALPATE_CACHE="$work/small/c" "$PALPATE" info scene.yaml >out 2>log &&
		grep -q "not cached.*No space left" log && [ -z "$(find small -type f)" ]
	check "a cache that is full costs the cache only" $?
	cp scene.yaml r.h5 fixed && mount --bind fixed fixed && mount -o remount,bind,ro fixed && (
		cd fixed || exit 1
		for c in "run scene.yaml --record x.h5" "run scene.yaml --snapshot x.png" "plot r.h5" \
			"precompute scene.yaml -o m.palpate"; do
			# shellcheck disable=SC2086
			"$PALPATE" $c >../out 2>../log && exit 1
			grep -q "Read-only file system; choose another place" ../log || exit 1
		done
		"$PALPATE" run scene.yaml --for 0.1 --freewheel --no-draw >../out 2>../log
	)
	check "a folder that is read only: said where something is written, no matter elsewhere" $?
else
	n=$((n + 1)); echo "ok $n - full disk # SKIP no mount here"
fi

# ---- interrupts, each signal twice at once, as `timeout` and shells send it to a process and its group
interrupt() { # interrupt SIGNAL ARGUMENTS...: into $status
	signal=$1; shift
	"$PALPATE" "$@" >out 2>log &
	pid=$!
	i=0
	while [ "$i" -lt 300 ] && [ "$(stat -c %s i.h5.ticks 2>/dev/null || echo 0)" -lt 20000 ]; do sleep 0.1; i=$((i + 1)); done
	kill -s "$signal" "$pid"; kill -s "$signal" "$pid" 2>/dev/null
	wait "$pid"; status=$?
}
for s in "TERM 143" "INT 130"; do
	rm -f i.*
	# a background job of a script ignores INT; the program's own handler takes it all the same
	interrupt "${s% *}" run m.palpate --for 3600 --no-realtime --record i.h5 --snapshot i.png --gif i.gif --json
	[ "$status" -eq "${s#* }" ] && [ -e i.h5 ] && [ -e i.png ] && [ -e i.gif ] && [ -e i.xdmf ] &&
		grep -q '"peak_force"' out && [ "$(ls i.* | wc -l)" -eq 4 ]
	check "SIG${s% *}: report, picture, animation and recording whole, status ${s#* }" $?
done
"$PALPATE" replay i.h5 >log 2>&1 && grep -q "differences: 0 of" log
check "and the recording replays" $?
if command -v xvfb-run >/dev/null 2>&1; then
	cat >view.sh <<'EOS'
"$PALPATE" view m.palpate --for 60 --json >out 2>log &
pid=$!
sleep 3; kill -s INT "$pid"; wait "$pid"; echo $? >status
EOS
	xvfb-run -a sh view.sh
	[ "$(cat status)" -eq 130 ] && grep -q '"frames"' out
	check "SIGINT: view closes its window, reports, status 130" $?
else
	n=$((n + 1)); echo "ok $n - view # SKIP no xvfb-run"
fi
finish
