#!/bin/sh
# Installs the Debian packages that a group of parts needs, when one is missing and we may.
# Usage: system-packages.sh service|fonts|tests|docker|standins ...
set -eu

missing="" fonts=""
need() { # need PACKAGE... : remember packages
    missing="$missing $*"
}

for group in "$@"; do
    case "$group" in
        service) ldconfig -p | grep -q libEGL.so.1 && ldconfig -p | grep -q libGL.so.1 &&
            ls /usr/share/glvnd/egl_vendor.d/*.json >/dev/null 2>&1 || need libegl1 libgl1 libgl1-mesa-dri ;;
        fonts) # 69 MB to load; whoever has these fonts elsewhere names their folder
            [ -n "${MESHMARK_FONTS:-}" ] || {
                [ -e /usr/share/fonts/truetype/noto/NotoSansThai-Bold.ttf ] || fonts="$fonts fonts-noto-core"
                [ -e /usr/share/fonts/opentype/noto/NotoSansCJK-Bold.ttc ] || fonts="$fonts fonts-noto-cjk"
            } ;;
        tests)
            command -v redis-server >/dev/null || need redis-server
            command -v initdb >/dev/null || ls /usr/lib/postgresql/*/bin/initdb >/dev/null 2>&1 || need postgresql
            command -v curl >/dev/null || need curl
            command -v node >/dev/null && command -v npm >/dev/null || need nodejs npm
            command -v prusa-slicer >/dev/null || need prusa-slicer
            command -v chromium >/dev/null || command -v google-chrome >/dev/null || need chromium ;;
        docker) [ -x /usr/bin/dockerd ] || command -v dockerd >/dev/null || need docker.io ;;
        standins) command -v mmdebstrap >/dev/null || need mmdebstrap ;;
        *) echo "unknown group: $group" >&2; exit 2 ;;
    esac
done

[ -n "$missing$fonts" ] || exit 0
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing $fonts >/dev/null
    exit 0
fi
if [ -n "$fonts" ]; then
    echo "Text in Chinese, Arabic, Hindi and the like needs fonts: sudo apt-get install$fonts, or set MESHMARK_FONTS" >&2
fi
if [ -n "$missing" ]; then
    echo "Missing system packages. Install them and try again: sudo apt-get install$missing" >&2
    exit 1
fi
