#!/bin/sh
# What `make install` puts below a prefix is enough for a host: README's ten-line example and a small
# trainer (haptic/program/embed/trainer.c) are compiled with pkg-config alone and run on a model. The
# online library and `palpate run MODEL` load nothing GPL. `make uninstall` leaves nothing.
set -u
if [ "${VARIANT:-plain}" != plain ]; then
	echo "1..0 # SKIP a host without sanitizers cannot link a library with them"
	exit 0
fi
. "$PALPATE_SOURCE/tests/support/shell.sh"
prefix=$work/prefix
unset MAKEFLAGS MFLAGS MAKELEVEL # of the make that runs the tests: its job server is not ours
make_in() { make --no-print-directory -C "$PALPATE_SOURCE" BUILD="$BUILD" CC="$CC" "$@" >"$work/log" 2>&1; }
value() { awk -v k="$2" '$1 == k { print $2 }' "$1"; } # value FILE KEY
test_that() { awk "BEGIN { exit !($1) }"; }             # test_that EXPRESSION

# ---- install ---------------------------------------------------------------------------------------
make_in install PREFIX="$prefix"
check "make install PREFIX=..." $?
make_in install DESTDIR="$work/stage" PREFIX=/opt/palpate
[ "$(cd "$prefix" && find . | sort)" = "$(cd "$work/stage/opt/palpate" && find . | sort)" ]
check "make install DESTDIR=... puts the same below DESTDIR" $?
! grep -r -q "$work/stage" "$work/stage/opt/palpate/lib/pkgconfig" &&
	grep -q '^prefix=/opt/palpate$' "$work/stage/opt/palpate/lib/pkgconfig/palpate.pc"
check "and no installed file names DESTDIR" $?
ls "$PALPATE_SOURCE/include/palpate" >"$work/headers"
ls "$prefix/include/palpate" | diff "$work/headers" - >"$work/log"
check "every public header is installed, nothing else" $?
for h in $(cat "$work/headers"); do
	printf '#include <palpate/%s>\nint main(void) { return 0; }\n' "$h" >"$work/h.c"
	"$CC" -std=c11 -Wall -Wextra -Wpedantic -Werror -I"$prefix/include" -fsyntax-only "$work/h.c" &&
		"$CC" -x c++ -std=c++17 -Wall -Wextra -Werror -I"$prefix/include" -fsyntax-only "$work/h.c" ||
		echo "$h" >>"$work/refused"
done >"$work/log" 2>&1
[ ! -e "$work/refused" ]
check "each compiles alone, as C11 and as C++17" $?
PATH=$prefix/bin:$PATH
PKG_CONFIG_PATH=$prefix/lib/pkgconfig; export PKG_CONFIG_PATH
[ "$(command -v palpate)" = "$prefix/bin/palpate" ] &&
	[ "$(palpate --version | grep -o '[0-9.]*[0-9]' | head -1)" = "$(pkg-config --modversion palpate)" ]
check "the installed program and pkg-config agree on the version" $?

# ---- a model, made by the installed program ----------------------------------------------------------
cat >"$work/scene.yaml" <<'YAML'
palpate: 1
body:
  geometry: {hemisphere: {radius: 0.05}}
  spacing: 0.012
  refine: [{center: [0, 0, 0.05], radius: 0.01, spacing: 0.003}]
  material: {young: 10e3, poisson: 0.45}
  fixed: [{below: {z: 0}}]
  touchable: [{ball: {center: [0, 0, 0.05], radius: 0.02}}]
tools:
  - name: probe
    shape: {sphere: {radius: 0.004}}
    device: {scripted: {kind: press, depth: 0.003}}
    start: [0, 0, 0.054]
    axis: [0, 0, -1]
YAML
(cd "$work" && palpate precompute scene.yaml -o m.palpate) >"$work/log" 2>&1
check "palpate precompute" $?

# ---- README's example ----------------------------------------------------------------------------------
readme=${PALPATE_README:-$PALPATE_SOURCE/README.md}
if [ -e "$readme" ]; then
	sed -n '/<!-- embed begin -->/,/<!-- embed end -->/p' "$readme" | sed '/^<!--/d; /^```/d' >"$work/ten_lines.c"
	[ -s "$work/ten_lines.c" ]
	check "README.md has its example between <!-- embed begin --> and <!-- embed end -->" $?
	# shellcheck disable=SC2046
	"$CC" -std=c11 -Wall -Wextra -Wpedantic -Werror "$work/ten_lines.c" $(pkg-config --cflags --libs palpate) \
		-o "$work/ten_lines" >"$work/log" 2>&1
	check "it compiles with pkg-config alone" $?
	LD_LIBRARY_PATH=$prefix/lib "$work/ten_lines" "$work/m.palpate" >"$work/out" 2>"$work/log"
	check "it runs" $?
	cat "$work/out" >>"$work/log"
	# A rigid sphere of 4 mm, 2 mm deep in a sphere of 50 mm, E = 10 kPa, nu = 0.45: Hertz says
	# 4/3 E/(1-nu^2) sqrt(3.7 mm) (2 mm)^1.5 = 0.091 N. Nodes 3 mm apart beneath a contact of 2.7 mm
	# give no more than the order; up means out of the body.
	fz=$(grep -o -e '[-+0-9.e]*  *N *$' "$work/out" | awk '{ print $1 }')
	test_that "${fz:-0} > 0.02 && ${fz:-0} < 0.4"
	check "the force pushes the tool out of the body (${fz:-none} N; Hertz: 0.091 N)" $?
	! LD_LIBRARY_PATH=$prefix/lib "$work/ten_lines" /nonexistent >"$work/log" 2>&1 && grep -q nonexistent "$work/log"
	check "a missing model is a message and exit status 1" $?
else
	n=$((n + 1)); echo "ok $n - README's example # SKIP no README.md"
fi

# ---- the trainer, with its own textured mesh -----------------------------------------------------------
# shellcheck disable=SC2046
"$CC" -std=c17 -D_GNU_SOURCE -O1 -Wall -Wextra -Werror "$PALPATE_SOURCE/haptic/program/embed/trainer.c" \
	$(pkg-config --cflags --libs palpate) -lpthread -lm -o "$work/trainer" >"$work/log" 2>&1
check "the trainer compiles with pkg-config alone" $?
LD_LIBRARY_PATH=$prefix/lib "$work/trainer" "$work/m.palpate" 1 >"$work/out" 2>"$work/log"
check "it runs its own loops" $?
cat "$work/out" >>"$work/log"
[ "$(value "$work/out" ticks)" -eq 1000 ] && [ "$(value "$work/out" frames)" -ge 1 ]
check "1000 ticks, $(value "$work/out" frames) frames" $?
f=$(value "$work/out" force_along_axis)
# 4 mm deep: Hertz 0.26 N against the pressing direction
test_that "${f:-0} < -0.06 && ${f:-0} > -1.1"
check "the force opposes the press (${f:-none} N along the axis)" $?
u=$(value "$work/out" deepest_vertex)
# no vertex is pushed further than the tool has gone, and nearly so beneath it
test_that "${u:-0} > 0.5 * 0.004 && ${u:-0} < 1.05 * 0.004"
check "the surface follows (${u:-none} m of 0.004 m)" $?
test_that "$(awk '$1 == "normal_lengths" { print "(" $2 " > 0.9999 && " $3 " < 1.0001)" }' "$work/out")"
check "normals are unit" $?
# Its own mesh, in millimetres and finer than the nodes: the pole (vertex 1) and 12 rings of 48 vertices
# around it, textured by angle and ring. The texture is cut at angle 0: 48 + 1 texture columns.
awk 'BEGIN { m = 48; k = 12; pi = atan2(0, -1)
	print "v 0 0 50"
	for (i = 1; i <= k; i++) for (j = 0; j < m; j++) {
		a = 0.06 * i; b = 2 * pi * j / m
		printf "v %.9g %.9g %.9g\n", 50 * sin(a) * cos(b), 50 * sin(a) * sin(b), 50 * cos(a) }
	for (i = 0; i <= k; i++) for (j = 0; j <= m; j++) printf "vt %.9g %.9g\n", j / m, i / k
	for (i = 0; i < k; i++) for (j = 0; j < m; j++) {
		q = (j + 1) % m; t = i * (m + 1) + j + 1; u = t + m + 1
		a = i ? 2 + (i - 1) * m + j : 1; b = i ? 2 + (i - 1) * m + q : 1
		c = 2 + i * m + j; d = 2 + i * m + q
		printf "f %d/%d %d/%d %d/%d\n", a, t, c, u, d, u + 1
		if (i) printf "f %d/%d %d/%d %d/%d\n", a, t, d, u + 1, b, t + 1 } }' >"$work/dome.obj"
{ cat "$work/scene.yaml"; echo 'skin: {file: dome.obj, scale: 0.001}'; } >"$work/dressed.yaml"
(cd "$work" && palpate precompute dressed.yaml -o dressed.palpate) >"$work/log" 2>&1
check "palpate precompute with skin: {file: dome.obj}" $?
LD_LIBRARY_PATH=$prefix/lib "$work/trainer" "$work/dressed.palpate" 0.5 "$work/dome.obj" 0.001 "$work/pressed.obj" \
	>"$work/out" 2>"$work/log"
check "the trainer draws its own textured mesh" $?
cat "$work/out" >>"$work/log"
# the pole has 48 texture coordinates, each ring's first vertex two
[ "$(value "$work/out" skin_vertices)" -eq 577 ] && [ "$(value "$work/out" vertices)" -eq $((577 + 47 + 12)) ]
check "577 vertices, 636 entries of the vertex buffer" $?
u=$(value "$work/out" deepest_vertex)
# the tool ends 4 mm below the pole's rest height; the mesh has a vertex there
test_that "${u:-0} > 0.8 * 0.004 && ${u:-0} < 1.05 * 0.004"
check "its vertices follow the tool (${u:-none} m of 0.004 m)" $?
test_that "$(awk '$1 == "normal_lengths" { print "(" $2 " > 0.9999 && " $3 " < 1.0001)" }' "$work/out")"
check "with unit normals" $?
# every corner of the written mesh: texture as in the file, place as in the file but for the displacement
corners() { awk -v s="$2" '$1 == "v" { v[++n] = $2 * s " " $3 * s " " $4 * s } $1 == "vt" { t[++m] = $2 " " $3 }
	$1 == "f" { for (i = 2; i <= 4; i++) { split($i, p, "/"); print v[p[1]], t[p[2]] } }' "$1"; }
corners "$work/dome.obj" 0.001 >"$work/a"
corners "$work/pressed.obj" 1 >"$work/b"
paste -d' ' "$work/a" "$work/b" | awk '{ d = (($1-$6)^2 + ($2-$7)^2 + ($3-$8)^2)^0.5; if (d > e) e = d
	if (d > 0.0045 || ($4-$9)^2 + ($5-$10)^2 > 1e-12) bad++ } END { exit !(NR == 3 * 1104 && !bad && e > 0.003) }'
check "and every corner keeps its texture coordinates" $?
sed -e '/^vt/d' -e 's|/[0-9]*||g' "$work/dome.obj" >"$work/bare.obj"
LD_LIBRARY_PATH=$prefix/lib "$work/trainer" "$work/dressed.palpate" 0.1 "$work/bare.obj" 0.001 >"$work/out" 2>"$work/log" &&
	[ "$(value "$work/out" vertices)" -eq 577 ]
check "a mesh without texture coordinates will do" $?
! LD_LIBRARY_PATH=$prefix/lib "$work/trainer" "$work/m.palpate" 0.1 "$work/dome.obj" 0.001 >"$work/log" 2>&1 &&
	grep -q 'skin:' "$work/log"
check "a model made without that mesh is told from one made with it" $?
# shellcheck disable=SC2046
"$CC" -std=c17 -D_GNU_SOURCE "$PALPATE_SOURCE/haptic/program/embed/trainer.c" $(pkg-config --cflags palpate) \
	"$prefix/lib/libpalpate.a" $(pkg-config --static --libs palpate | sed 's/-lpalpate//') \
	-o "$work/trainer_static" >"$work/log" 2>&1 &&
	"$work/trainer_static" "$work/m.palpate" 0.1 >"$work/out" 2>"$work/log"
check "linked statically (pkg-config --static) it runs without LD_LIBRARY_PATH" $?

# ---- nothing GPL at run time ---------------------------------------------------------------------------
gpl='umfpack|cholmod|spqr|klu|metis|gmsh|palpate-offline|libarpack|libassimp|fftw|libgsl|libreadline'
readelf -d "$prefix/lib/libpalpate.so" | awk -F'[][]' '/NEEDED/ { print $2 }' | sort >"$work/log"
! grep -v -x -E 'lib(c|m|pthread|hdf5_serial)\.so\.[0-9]+' "$work/log"
check "libpalpate.so needs libc, libm, libpthread and libhdf5_serial only" $?
ldd "$prefix/lib/libpalpate.so" >"$work/log" && grep -q hdf5 "$work/log" && ! grep -E "$gpl" "$work/log"
check "nor does what those need load a GPL library" $?
LD_DEBUG=files LD_DEBUG_OUTPUT=$work/ld palpate run "$work/m.palpate" --for 0.5 --snapshot "$work/p.png" >"$work/log" 2>&1
check "palpate run MODEL, picture included" $?
cat "$work"/ld.* | grep -o 'file=[^ ]*' | sort -u >"$work/loaded"
grep -q libpalpate.so "$work/loaded" && grep -q hdf5 "$work/loaded" && ! grep -E "$gpl" "$work/loaded" >"$work/log"
check "loads no GPL library ($(wc -l <"$work/loaded") loaded)" $?
rm -f "$work"/ld.*
LD_DEBUG=files LD_DEBUG_OUTPUT=$work/ld palpate info "$work/scene.yaml" >/dev/null 2>&1
LD_DEBUG=files LD_DEBUG_OUTPUT=$work/ld palpate precompute "$work/scene.yaml" -o "$work/m2.palpate" >/dev/null 2>&1
cat "$work"/ld.* | grep -q -E "$gpl"
check "(the same look at palpate precompute does find some)" $?

# ---- uninstall -----------------------------------------------------------------------------------------
make_in uninstall PREFIX="$prefix"
check "make uninstall" $?
find "$prefix" \( ! -type d -o -name '*palpate*' \) >"$work/log"
[ ! -s "$work/log" ]
check "leaves nothing" $?
finish
