# Sourced: sets ENGINE to docker, podman or buildah, and defines functions that use it.

find_engine() {
    local name
    for name in docker podman buildah; do
        if "$name" info >/dev/null 2>&1; then
            echo "$name"
            return
        fi
    done
    echo "none of docker, podman and buildah works here; install one" >&2
    return 1
}

ENGINE=${ENGINE:-$(find_engine)}

build_image() {
    case $ENGINE in
    docker) docker build "$@" ;;
    *) "$ENGINE" build --layers "$@" ;;
    esac
}

# Megabytes of an image's files.
image_size() {
    case $ENGINE in
    buildah) buildah images --format '{{.Size}}' "localhost/$1" | head -n 1 ;;
    *) "$ENGINE" image inspect --format '{{.Size}}' "$1" | awk '{ printf "%.0f MB\n", $1 / 1e6 }' ;;
    esac
}
