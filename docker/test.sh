#!/usr/bin/env bash
# Tracks the demo's sequence with the images: a coordinator, a router and two workers, each in a container of its
# own, with certificates. No file of this checkout is used. A run in one container must give the same bytes.
# docker/test.sh [FRAMES]
set -euo pipefail -m # each job is a process group and is killed as one
cd "$(dirname "$0")/.."
. docker/engine.sh
. docker/container.sh

frames=${1:-20}
port=${PORT:-17447}
DATA=$(mktemp -d)
chmod 777 "$DATA"
running=()
stop() {
    local job
    for job in "${running[@]}"; do
        kill -- "-$job" 2>/dev/null || true
    done
    wait
    remove_containers
    rm -rf "$DATA"
}
trap stop EXIT
say() { printf '== %s\n' "$*" >&2; }
tls() { printf -- '--tls-ca /data/certificates/ca.pem --tls-cert /data/certificates/%s.pem --tls-key /data/certificates/%s.key' "$1" "$1"; }

say "certificates and the demo's sequence, $frames frames"
run_image gepf-coordinator gepf certificates --out /data/certificates --workers 2 --hosts 127.0.0.1
run_image gepf-coordinator gepf synth arm --out /data/sequence --frames "$frames" --noise-depth 0.15 --noise-lateral 0.01

say "a router and two workers"
endpoint=tls/127.0.0.1:$port
# shellcheck disable=SC2046
run_image gepf-coordinator gepf router --listen "$endpoint" $(tls router) &
running+=($!)
for name in worker-0 worker-1; do
    # shellcheck disable=SC2046
    run_image gepf-worker gepf-worker --connect "$endpoint" $(tls "$name") &
    running+=($!)
done

track=(gepf track /data/sequence --dof r_shoulder_flexion,r_shoulder_abduct,r_shoulder_twisting,r_elbow_flexion)
say "a run on the workers in their containers"
# shellcheck disable=SC2046
run_image gepf-coordinator "${track[@]}" --out /data/apart --workers 0 --connect "$endpoint" $(tls coordinator)

say "each worker is healthy"
for name in worker-0 worker-1; do
    # shellcheck disable=SC2046
    run_image gepf-worker gepf-worker --check --connect "$endpoint" $(tls "$name")
done

say "no kernel is compiled anew"
run_image gepf-worker sh -c \
    'python -c "from gepf.worker.cli import load_kernel; load_kernel(None)" && diff -r /opt/gepf/kernels /tmp/kernels'

say "the same run inside one container"
run_image gepf-coordinator "${track[@]}" --out /data/together --workers 2
cmp "$DATA/apart/track.npz" "$DATA/together/track.npz"
grep -A 3 '"workers_seen"' "$DATA/apart/summary.json"
say "equal: $(sha256sum <"$DATA/apart/track.npz" | cut -c1-16)"
