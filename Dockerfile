# An image with everything built, for a first look and for continuous integration:
#
#   docker build -t flexarm_ros . && docker run --rm flexarm_ros make run
#   docker run --rm -v "$PWD/runs:/flexarm_ros/runs" flexarm_ros .venv/bin/flexarm run fls_mid
#
# Debian 12 has Python 3.11; rclpy comes from wheels, pinned in constraints/ (docs/install.md).
FROM debian:12-slim

# hadolint ignore=DL3008 (mirrors of Debian keep the newest version of a package only)
RUN apt-get update \
    && apt-get install -y --no-install-recommends ca-certificates chromium git iproute2 make python3-venv \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /flexarm_ros
COPY . .
RUN make env

ENV PATH=/flexarm_ros/.venv/bin:$PATH
CMD ["make", "run"]
