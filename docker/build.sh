#!/usr/bin/env bash
# Builds the images with docker, podman or buildah: docker/build.sh [worker] [coordinator]
# BASE is the Debian base image, KERNEL_CPU the oldest processor on which the kernels must run.
set -euo pipefail
cd "$(dirname "$0")/.."
. docker/engine.sh

options=()
for name in BASE KERNEL_CPU; do
    [ -z "${!name:-}" ] || options+=(--build-arg "$name=${!name}")
done
if [ -n "${PIP_CERT:-}" ]; then
    config=$(mktemp)
    trap 'rm -f "$config"' EXIT
    printf '[global]\ncert = /run/secrets/ca\n' >"$config"
    options+=(--secret "id=pip,src=$config" --secret "id=ca,src=$PIP_CERT")
fi

[ $# -gt 0 ] || set -- worker coordinator
for image in "$@"; do
    build_image "${options[@]}" --tag "gepf-$image" --file "docker/$image.Dockerfile" .
    printf '%s: %s\n' "gepf-$image" "$(image_size "gepf-$image")"
done
