#!/bin/sh
# Draws the passwords of compose.yaml, once, into the folder named, or docker/secrets. What is there is kept.
# Docker mounts each file as it is, for users of other numbers than yours: the files are readable, the folder is not.
set -eu
folder=${1:-$(dirname "$0")/secrets}
mkdir -p "$folder"
chmod 700 "$folder"

secret() { # secret NAME TEXT
    [ -e "$folder/$1" ] || { printf '%s' "$2" >"$folder/$1"; chmod 444 "$folder/$1"; }
}
random() { head -c 24 /dev/urandom | od -An -tx1 | tr -d ' \n'; }

secret postgres_password "$(random)"
secret redis_password "$(random)"
secret meshmark_s3_access_key_id "$(random)"
secret meshmark_s3_secret_access_key "$(random)"
secret meshmark_database_url "postgresql://meshmark:$(cat "$folder/postgres_password")@postgres:5432/meshmark"
secret meshmark_broker_url "redis://:$(cat "$folder/redis_password")@redis:6379/0"
secret secrets-key "$(head -c 32 /dev/urandom | base64 | tr '+/' '-_')" # of webhooks' secrets: a Fernet key
secret redis.conf "requirepass $(cat "$folder/redis_password")
appendonly yes
maxmemory-policy noeviction
"
secret store.json "{\"identities\": [{\"name\": \"meshmark\", \"actions\": [\"Read\", \"Write\", \"List\"], \"credentials\": [
{\"accessKey\": \"$(cat "$folder/meshmark_s3_access_key_id")\", \"secretKey\": \"$(cat "$folder/meshmark_s3_secret_access_key")\"}]}]}"
