# Stands in for Docker Hub's chrislusf/seaweedfs: its program as PyPI has it, and the few others that are beside it there.
FROM meshmark-standin/debian
RUN apt-get update && apt-get install -y --no-install-recommends busybox && rm -rf /var/lib/apt/lists/* \
    && ln -s /bin/busybox /usr/bin/wget && mkdir -p /etc/seaweedfs /data/filerldb2 \
    && printf '[leveldb2]\nenabled = true\ndir = "/data/filerldb2"\n' >/etc/seaweedfs/filer.toml
COPY --chmod=755 weed /usr/bin/weed
VOLUME /data
ENTRYPOINT ["/usr/bin/weed"]
