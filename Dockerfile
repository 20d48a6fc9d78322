# One image for every process of a run; the command says which one a container is:
#
#   docker build -t crossfix .
#   docker run --rm crossfix --help
#
# Without a registry: docker/base-image.sh, then --build-arg BASE=crossfix-base.
# Without a package index: docker/wheels.sh first.
ARG BASE=python:3.11-slim

FROM ${BASE} AS dependencies
LABEL org.crossfix.stage=build
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
# pip stays behind in an environment of its own.
RUN python3 -m venv /opt/pip && python3 -m venv --without-pip /opt/crossfix
COPY docker/wheels /wheels
RUN if ls /wheels/*.whl >/dev/null 2>&1; then \
        printf '[global]\nno-index = true\nfind-links = /wheels\n' >/etc/pip.conf; \
    fi
COPY pyproject.toml docker/requirements.py /source/
RUN cd /source && python3 requirements.py pyproject.toml >requirements.txt \
    && /opt/pip/bin/pip --python /opt/crossfix install --requirement requirements.txt

# Beside the dependencies, so that a changed line of ours is a small layer.
FROM dependencies AS application
LABEL org.crossfix.stage=build
COPY . /source
RUN /opt/pip/bin/pip --python /opt/crossfix install --no-deps --target /opt/application /source \
    && install -m 755 /source/docker/healthy.py /opt/application/bin/healthy

FROM ${BASE}
LABEL org.opencontainers.image.title=crossfix org.opencontainers.image.licenses=Apache-2.0
ENV PATH=/opt/application/bin:/opt/crossfix/bin:$PATH \
    PYTHONPATH=/opt/application \
    PYTHONUNBUFFERED=1 \
    HOME=/tmp
COPY --from=dependencies /opt/crossfix /opt/crossfix
# A new volume takes over its owner.
RUN install -d -o 10001 -g 10001 /crossfix/recordings
COPY scenarios /crossfix/scenarios
COPY --from=application /opt/application /opt/application
USER 10001:10001
WORKDIR /crossfix
VOLUME /crossfix/recordings
ENTRYPOINT ["crossfix"]
CMD ["--help"]
