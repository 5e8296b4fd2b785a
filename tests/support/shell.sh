# Sourced by test_*.sh: a directory of its own in $work, gone at the end, and TAP.
work=$(mktemp -d); trap 'rm -rf "$work"' EXIT
n=0; bad=0
check() { # check NAME STATUS: $work/log tells why when it fails
	n=$((n + 1))
	if [ "$2" -eq 0 ]; then echo "ok $n - $1"; else
		echo "not ok $n - $1"; bad=1; sed 's/^/# /' "$work/log" 2>/dev/null | tail -n 12
	fi
}
finish() { echo "1..$n"; exit $bad; }
number() { sed -n 's/.*"'"$1"'": *\([-0-9.e+]*\).*/\1/p' "$2" | head -n 1; } # number KEY JSON
small_scene() { # small_scene STROKE: $work/scene.yaml, a soft plate under a probe
	cat >"$work/scene.yaml" <<-END
	palpate: 1
	body:
	  geometry: {box: {size: [0.04, 0.04, 0.02], center: [0, 0, -0.01]}}
	  spacing: 0.006
	  material: {young: 10e3, poisson: 0.4}
	  fixed: [{below: {z: -0.02}}]
	tools:
	  - name: probe
	    shape: {sphere: {radius: 0.006}}
	    device: {scripted: $1}
	    start: [0, 0, 0.006]
	    axis: [0, 0, -1]
	END
}
