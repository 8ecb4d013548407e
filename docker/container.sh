# Sourced after engine.sh: runs a command in an image as in production, with a user of its own, a file system that
# is read-only except for /tmp, and the host's network. The host's folder DATA is mounted as /data.

# run_image IMAGE COMMAND...
run_image() {
    local image=$1
    shift
    case $ENGINE in
    buildah) run_in_chroot "$image" "$@" ;;
    *)
        "$ENGINE" run --rm --read-only --tmpfs /tmp --network host --cap-drop ALL \
            --security-opt no-new-privileges --volume "$DATA:/data" --entrypoint entrypoint "$image" "$@"
        ;;
    esac
}

# Buildah only builds images, so this runs the command with namespaces of mounts and processes.
run_in_chroot() {
    local image=$1 container root environment
    shift
    container=$(buildah from --quiet --pull-never "localhost/$image")
    root=$(buildah mount "$container")
    mapfile -t environment < <(buildah inspect --format '{{range .OCIv1.Config.Env}}{{println .}}{{end}}' "$container" | sed '/^$/d')
    echo "$container" >>"$DATA/containers"
    mkdir -p "$root/data"
    ROOT=$root DATA=$DATA unshare --mount --pid --fork --kill-child -- bash -euc '
        mount --make-rprivate /
        mount --bind "$ROOT" "$ROOT"
        mount -o remount,bind,ro "$ROOT"
        mount -t tmpfs tmpfs "$ROOT/tmp"
        mount -t proc proc "$ROOT/proc"
        mount --rbind /dev "$ROOT/dev"
        mount --bind "$DATA" "$ROOT/data"
        exec chroot --userspec=10001:10001 --groups= "$ROOT" env -i "$@"
    ' run "${environment[@]}" sh -c 'cd /tmp && exec entrypoint "$@"' run "$@"
}

# Docker and podman remove a container when it ends; this removes those of buildah.
remove_containers() {
    [ ! -e "$DATA/containers" ] || xargs buildah rm <"$DATA/containers" >/dev/null
}
