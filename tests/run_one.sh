#!/bin/sh
# Run one test for run.sh: log, status and a one-line sum below $logs. Usage: run_one.sh TEST
set -u
t=$1
name=$(basename "$t"); name=${name%.sh}
start=$(date +%s)
case $t in *.sh) command=sh ;; *) command= ;; esac
# timeout leads a process group of its own, which Ctrl-C does not reach: in the background, so that a
# trap can end all of it. (There, a shell ignores SIGINT and so would the tests: hence env.)
# shellcheck disable=SC2086
env --default-signal=INT,QUIT timeout -k 5 "${TEST_TIMEOUT:-300}" $command "$t" >"$logs/$name.log" 2>&1 </dev/null &
pid=$!
trap 'kill "$pid" 2>/dev/null; wait "$pid"; exit 130' INT TERM HUP
wait "$pid"
status=$?
trap - INT TERM HUP
echo "$status" >"$logs/$name.status"
awk -v n="$name" -v s="$status" -v d="$(($(date +%s) - start))" '
	/# [Ss][Kk][Ii][Pp]/ { skip++; next } /^ok / { ok++ } /^not ok / { bad++ }
	END { if (s != 0 && !bad) bad = 1; if (!ok && !bad && !skip) bad = 1
	      printf "%-40s %4d passed %3d failed %3d skipped %4d s%s\n", n, ok, bad, skip, d,
	             (s == 124 || s == 137) ? "  TIMEOUT" : (s != 0 && s < 126 ? "" : (s ? "  status " s : "")) }' \
	"$logs/$name.log" | tee "$logs/$name.sum"
