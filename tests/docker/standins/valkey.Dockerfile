# Stands in for Docker Hub's valkey/valkey: Debian's Redis under Valkey's names.
FROM meshmark-standin/debian
RUN groupadd --gid 1000 valkey && useradd --uid 999 --gid 1000 --no-create-home valkey \
    && apt-get update && apt-get install -y --no-install-recommends redis-server && rm -rf /var/lib/apt/lists/* \
    && ln -s /usr/bin/redis-server /usr/local/bin/valkey-server && ln -s /usr/bin/redis-cli /usr/local/bin/valkey-cli \
    && install -d -o 999 -g 1000 /data
VOLUME /data
CMD ["valkey-server"]
