#!/bin/sh
# What is typed at `palpate`: every command, wrong values, files of the wrong kind, --set where no
# scene is built, bytes that are not UTF-8, closed and full standard streams. Each message must name
# the place and the remedy; exit status 2 is wrong usage, 1 failure, 0 only success.
set -u
. "$PALPATE_SOURCE/tests/support/shell.sh"
cd "$work" || exit 1
mkdir "a b"
cat >"a b/scene.yaml" <<'EOS'
palpate: 1
body:
  geometry: {box: {size: [0.04, 0.04, 0.02], center: [0, 0, -0.01]}}
  spacing: 0.008
  material: {young: 10e3, poisson: 0.4}
  fixed: [{below: {z: -0.02}}]
  patches: {top: {ball: {center: [0, 0, 0], radius: 0.008}, rim_spacing: 0.004}}
tools:
  - name: probe
    shape: {sphere: {radius: 0.006}}
    device: {scripted: {kind: press, depth: 0.002}}
    start: [0, 0, 0.006]
    axis: [0, 0, -1]
    friction: 0.4
EOS
scene="a b/scene.yaml"
# says STATUS TEXT ARGUMENTS...: the program ends with STATUS, TEXT is on stderr, stdout is empty
says() {
	want=$1 text=$2; shift 2
	timeout 60 "$PALPATE" "$@" >out 2>log </dev/null
	got=$?
	[ "$got" -eq "$want" ] && grep -qF -- "$text" log && [ ! -s out ]
	check "$(echo "$*" | head -c 90 | tr '#\377' '..'): $want, $text" $?
}
"$PALPATE" precompute "$scene" -o m.palpate >out 2>log
check "a model of a scene whose path has a space" $?
"$PALPATE" run m.palpate --for 0.2 --freewheel --no-draw --record "a b/r.h5" >out 2>log
check "and a recording" $?

# ---- the commands themselves
for c in "" nonsense --json "help nonsense"; do
	# shellcheck disable=SC2086
	"$PALPATE" $c >out 2>log
	[ $? -eq 2 ] && [ ! -s out ] && grep -q "usage: palpate COMMAND" log
	check "palpate $c: wrong usage" $?
done
for c in precompute info press indent run recover replay plot view; do
	says 2 "which " $c
	says 2 "at a time" $c one two
	says 2 "unrecognized option" $c --bogus
done
# argp wraps at 79 columns, and a wrapped example is no command any more
for c in precompute info press indent run recover replay plot view doctor schema; do
	"$PALPATE" $c --help | sed -n '/^Example:/,/^$/p' | sed 1d >log
	[ -s log ] && ! grep -v -q -e '^ *$' -e '^  ' log
	check "palpate $c --help: every line of the example is whole" $?
done
for c in doctor schema; do says 2 "Too many arguments" $c extra; done

# ---- --set where no scene is built: refused in words, and not offered by --help
for c in "plot r.h5" "recover r.h5" doctor schema; do
	# shellcheck disable=SC2086
	says 2 "--set body.spacing=1: " $c --set body.spacing=1
	"$PALPATE" "${c%% *}" --help >log 2>&1 && ! grep -q -e --set log && grep -q -e --json log
	check "palpate ${c%% *} --help does not offer it" $?
done
for c in precompute info press indent run replay view; do
	"$PALPATE" $c --help >log 2>&1 && grep -q -e --set=KEY=VALUE log
	check "palpate $c --help does" $?
done
says 1 "give the scene instead" run m.palpate --set body.spacing=1
says 1 "give it with --model" replay "a b/r.h5" --set body.spacing=1

# ---- values
says 2 "more than 0, up to 1e7" run m.palpate --for nan
says 2 "more than 0, up to 1e7" run m.palpate --for ""
says 2 "more than 0, up to 1e7" run m.palpate --reference 1s
says 2 "more than 0, up to 1e7" view m.palpate --for -1
says 2 "a core, 0 to 4095" run m.palpate --cpu 99999999999
says 2 "64 to 4096" run m.palpate --size 99999999999x100
says 2 "64 to 4096" plot "a b/r.h5" --size 640x480x3
says 2 "a time in seconds" plot "a b/r.h5" --from x
says 2 "three numbers" press m.palpate --patch top --by 0,0,0,0
says 2 "three numbers" press m.palpate --patch top --by 0,,0
says 2 "numbers of 0 or more" indent m.palpate --tool probe --depths 0.001,
says 2 "numbers of 0 or more" indent m.palpate --tool probe --depths -1
says 2 "0.0001 to 1" precompute "$scene" --target-error 2
says 2 "a time per tick" precompute "$scene" --budget 3parsecs
says 2 "give --patch and --by" press m.palpate
says 2 "give --tool and --depths" indent m.palpate
says 1 "beyond all numbers" press m.palpate --patch top --by 0,0,1e308
says 1 "the tools are: probe" indent m.palpate --tool nope --depths 0.001
"$PALPATE" indent m.palpate --tool probe --depths 0.001,0.1 --json >out 2>log
[ $? -eq 0 ] && grep -q "its friction of 0.4 plays no part" log && grep -q "its friction of 0.4" out &&
	grep -q "largest depth is 0.1 m" out
check "indent says that friction plays no part and that 0.1 m is far beyond small strain" $?

# ---- files of the wrong kind
mkdir folder; : >empty; mkfifo pipe; printf '\200\201' >bytes
cp "$PALPATE_SOURCE/scenes/organ.obj" organ.obj; cp organ.obj renamed
printf 'ply\nformat ascii 1.0\n' >s.ply; printf 'solid a\nendsolid a\n' >s.stl
{ head -c 80 /dev/zero; printf '\001\000\000\000'; head -c 50 /dev/zero; } >binary
printf 'time,x,y,z\n0,0,0,0\n' >t.csv
for c in "run" "info" "view" "press --patch top --by 0,0,0" "indent --tool probe --depths 0"; do
	for f in organ.obj renamed s.ply s.stl binary; do
		# shellcheck disable=SC2086
		says 1 "body.geometry.file" $c $f
	done
done
says 1 "body.geometry.file" precompute organ.obj
says 1 "body.geometry.file" replay "a b/r.h5" --model organ.obj
says 1 "device: {replay: FILE}" run t.csv
says 1 "companion of a recording" run "a b/r.xdmf"
says 1 "a Palpate recording, not a model" run "a b/r.h5"
says 1 "a Palpate model, not a recording" plot m.palpate
says 1 "palpate info" precompute m.palpate --budget 2%
for c in run info precompute; do
	says 1 "begin it with 'palpate: 1'" $c empty
	says 1 "a folder; give the file of a scene" $c folder
	says 1 "not a regular file" $c pipe
	says 1 "byte 0x80" $c bytes
	says 1 "No such file" $c missing
	says 1 "not the name of a scene" $c ""
done
for c in plot replay; do
	says 1 "truncated" $c empty
	says 1 "not a regular file" $c folder
	says 1 "not a regular file" $c pipe
	says 1 "No such file" $c missing
done
says 1 "neither it nor its raw file missing.ticks" recover missing
says 1 "nothing to recover: no raw file" recover "a b/r.h5"
says 1 "give the name of the recording: x.h5" recover x.h5.ticks

for f in folder pipe; do
	sed "s/geometry:.*/geometry: {file: ..\/$f}/" "$scene" >"a b/geometry.yaml"
	says 1 "give an STL, OBJ or PLY file" info "a b/geometry.yaml"
done

# ---- bytes that are not UTF-8, very long arguments
b=$(printf 'x\377y'); cp "a b/r.h5" "$b.h5"
for c in plot replay; do
	"$PALPATE" $c "$b.h5" --json >out 2>log && grep -q "\"file\": \"x$(printf '\357\277\275')y.h5\"" out
	check "$c of a name that is not UTF-8: JSON all the same" $?
done
"$PALPATE" press m.palpate --patch "$b" --by 0,0,0 --json >out 2>log
[ $? -eq 1 ] && grep -q '"message"' out && grep -q "no such patch" out
check "and of an error about one" $?
long=$(head -c 5000 /dev/zero | tr '\0' a)
for c in info press run plot replay recover; do
	# shellcheck disable=SC2046
	"$PALPATE" $c "$long" $([ $c = press ] && echo --patch top --by 0,0,0) >out 2>log
	[ $? -eq 1 ] && grep -q -i "too long" log
	check "$c of 5000 letters: too long" $?
done

# ---- standard streams
for c in "--help" "run --help" schema "info m.palpate" "info m.palpate --json"; do
	# shellcheck disable=SC2086
	"$PALPATE" $c >/dev/full 2>log
	[ $? -eq 1 ] && [ "$(grep -c "standard output cannot be written" log)" -eq 1 ]
	check "palpate $c on a full disk: said once, no success" $?
	# shellcheck disable=SC2086
	"$PALPATE" $c 2>log >&-
	[ $? -eq 1 ] && grep -q "standard output cannot be written" log
	check "nor with standard output closed" $?
done
"$PALPATE" run m.palpate --for 0.2 --freewheel --no-draw --record closed.h5 <&- 2>log >&-
"$PALPATE" replay closed.h5 >log 2>&1 && grep -q "200 ticks" log
check "a run without standard streams writes nothing but its recording into it" $?
# more than a pipe holds, so that the program must meet the closed end
"$PALPATE" schema 2>log | head -n 1 >out; [ "$(wc -l <out)" -eq 1 ] && [ ! -s log ]
check "palpate schema | head -n 1: no complaint" $?
finish
