# A coordinator: all of `gepf`, including rendering without a display and local workers.
# Build it from the root of the project: docker/build.sh coordinator
ARG BASE=docker.io/library/debian:bookworm-slim

FROM ${BASE} AS python
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        libegl1 libegl-mesa0 libgl1 libgomp1 libstdc++6 libx11-6 python3 \
    && rm -rf /var/lib/apt/lists/* /var/cache/apt /var/log/* /usr/share/locale /usr/share/man /usr/share/info \
    && find /usr/share/doc -not -type d -not -name copyright -delete

FROM python AS build
# hadolint ignore=DL3008
RUN apt-get update && apt-get install -y --no-install-recommends python3-venv
WORKDIR /source
RUN python3 -m venv /opt/pip && python3 -m venv --without-pip /opt/gepf
COPY LICENSE README.md constraints.txt pyproject.toml ./
COPY docker/finish.sh docker/
COPY common common
COPY coordinator coordinator
COPY gepf gepf
COPY worker worker
# For packages through a mirror or proxy: its pip.conf and, at /run/secrets/ca, its certificate authority.
RUN --mount=type=secret,id=pip,target=/etc/pip.conf --mount=type=secret,id=ca \
    /opt/pip/bin/pip wheel --no-cache-dir --no-deps --wheel-dir /wheels . \
    && /opt/pip/bin/pip --python /opt/gepf install --no-cache-dir --no-compile --constraint constraints.txt \
        "gepf[robots,synth] @ file://$(echo /wheels/gepf-*.whl)" \
    && docker/finish.sh /opt/gepf
# Kernels are compiled for all processors with these instructions, so all run the same machine code.
ARG KERNEL_CPU=x86-64-v3
ENV NUMBA_CPU_NAME=${KERNEL_CPU} \
    NUMBA_CPU_FEATURES="" \
    NUMBA_CACHE_DIR=/opt/gepf/kernels
RUN /opt/gepf/bin/python -I -c "from gepf.worker.cli import load_kernel; load_kernel(None)"

# Only the files are copied, so files that the steps above removed are in no layer of the image.
FROM scratch
ARG KERNEL_CPU=x86-64-v3
# hadolint ignore=DL3067
COPY --from=python / /
COPY --from=build /opt/gepf /opt/gepf
COPY docker/entrypoint.sh /opt/gepf/bin/entrypoint
ENV PATH=/opt/gepf/bin:/usr/bin:/bin \
    HOME=/tmp \
    MPLCONFIGDIR=/tmp/matplotlib \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    PYOPENGL_PLATFORM=egl \
    NUMBA_CPU_NAME=${KERNEL_CPU} \
    NUMBA_CPU_FEATURES="" \
    NUMBA_CACHE_DIR=/tmp/kernels \
    OMP_NUM_THREADS=1 \
    OPENBLAS_NUM_THREADS=1
USER 10001:10001
WORKDIR /tmp
ENTRYPOINT ["entrypoint", "gepf"]
CMD ["--help"]
