#!/bin/sh
# The offline stage on one scene with OpenBLAS's kernels for several processors. Its sums depend on the
# kernel, so not the bits but a tolerance is promised: forces within TOLERANCE of their length.
# Usage: PALPATE=build/palpate offline.sh
# TOLERANCE: rounding (1e-16) times the condition of the compliance (1e4 to 1e6 here) with room; the
# default methods were seen to agree in all 12 digits printed, `point` to 2e-10.
set -u
work=$(mktemp -d); trap 'rm -rf "$work"' EXIT
cat >"$work/scene.yaml" <<'EOF'
palpate: 1
body:
  geometry: {box: {size: [0.04, 0.04, 0.02], center: [0, 0, -0.01]}}
  spacing: 0.006
  material: {young: 10e3, poisson: 0.45}
  fixed: [{below: {z: -0.02}}]
  patches: {top: {ball: {center: [0, 0, 0], radius: 0.008}}}
certify: warn
EOF
failed=0
for method in cell galerkin point; do
	for core in Haswell Nehalem Sandybridge; do
		OPENBLAS_CORETYPE=$core PALPATE_CACHE="$work/$method-$core" "$PALPATE" press "$work/scene.yaml" \
			--patch top --by 0.0005,0,-0.002 --set method.kind=$method --json 2>"$work/log" |
			tr -d ' \n' | sed 's/.*"force":\[\([^]]*\)\].*/\1\n/' >>"$work/$method" || { cat "$work/log"; failed=1; }
	done
	awk -F, -v m=$method '
		{ x[NR] = $1; y[NR] = $2; z[NR] = $3 }
		END {
			for (i = 2; i <= NR; i++) {
				d = sqrt((x[i] - x[1]) ^ 2 + (y[i] - y[1]) ^ 2 + (z[i] - z[1]) ^ 2) / sqrt(x[1] ^ 2 + y[1] ^ 2 + z[1] ^ 2)
				if (d > worst) worst = d
			}
			limit = m == "point" ? 1e-7 : 1e-9
			printf "offline: %s: forces of %d kernels within %.2g (limit %g)\n", m, NR, worst, limit
			exit !(NR == 3 && worst <= limit)
		}' "$work/$method" || failed=1
done
exit $failed
