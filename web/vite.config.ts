import { svelte } from '@sveltejs/vite-plugin-svelte';
import { defineConfig } from 'vitest/config';

// Relative base: the page works behind any reverse-proxy prefix. Nothing is inlined, so a strict
// Content-Security-Policy (`default-src 'self'`) holds.
export default defineConfig({
  base: './',
  plugins: [svelte()],
  build: {
    outDir: '../service/static',
    emptyOutDir: true,
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    target: 'es2022',
  },
  worker: { format: 'es' },
  server: {
    proxy: { '/api': 'http://127.0.0.1:8017' },
  },
  test: { include: ['src/**/*.test.ts'], environment: 'node' },
});
