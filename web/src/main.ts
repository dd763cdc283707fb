import { mount } from 'svelte';
import App from './App.svelte';
import './app.css';

const page = document.getElementById('page')!;
page.replaceChildren();
export default mount(App, { target: page });
