import { Server } from "./link.js";
import { start } from "./page.js";

// The token of the address is in a cookie by now; it need not be seen, and a link without it is what others may have.
const address = new URL(location.href);
if (address.searchParams.has("token")) {
  address.searchParams.delete("token");
  history.replaceState(null, "", address);
}
start(document.querySelector(".skyscatter"), new Server(), { address: true });
